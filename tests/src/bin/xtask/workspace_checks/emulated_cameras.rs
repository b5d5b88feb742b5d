//! Runs the camera tests in a virtual machine.

use anyhow::Result;
use multiscopic_tests::test_images::real_data::{self, Dataset};
use std::env::consts::ARCH;

use crate::{
    machine::{LINUX_TOOLS, Linux, Machine},
    system::{self, OPTIMIZED, built_optimized_program, built_test, command, run},
    tools::{self, debian},
};

/// The test program that needs cameras.
const TEST: &str = "cameras";

/// Runs the tests in release. Without a virtual machine they are reported as ignored.
pub fn run_tests() -> Result<()> {
    if let Some(reason) = missing() {
        println!("v4l2: no virtual machine: {reason}");
        return run(command("cargo", ["test", "--no-fail-fast", "--release", "--test", TEST]).args(OPTIMIZED));
    }
    let mut machine = Machine::new()?;
    let program = built_optimized_program()?;
    machine.add_program(&program)?;
    machine.add_folder(&system::root().join("tests/golden"))?;
    let mut variables = format!("MULTISCOPIC_CAMERAS=1 MULTISCOPIC_BINARY='{}'", program.display());
    if let Some(root) = real_data::root() {
        machine.add_folder(&root.join(Dataset::Tsukuba.name()))?;
        variables += &format!(" MULTISCOPIC_DATA='{}'", root.display());
    }
    let test = built_test(TEST)?;
    machine.add_program(&test)?;
    // The tests share the devices and change their settings, so they run one at a time.
    machine.run(&format!("cd /tmp; {variables} '{}' --test-threads 1 --color never", test.display()))
}

/// Returns the reason that no virtual machine can run here; `None` if one can.
fn missing() -> Option<String> {
    if ARCH != "x86_64" || !debian::is_here() {
        return Some("its kernel is Debian's for x86_64, and this is another system".into());
    }
    if debian::can_install() {
        return None;
    }
    let refused = [&tools::QEMU_X86].into_iter().chain(&LINUX_TOOLS).find_map(|tool| tool.install().err());
    match Linux::current() {
        _ if refused.is_some() => refused.map(|refusal| format!("{refusal:#}")),
        None => Some("no list of packages; run `sudo apt-get update` first".into()),
        Some(_) => None,
    }
}
