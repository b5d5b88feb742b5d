//! Runs the tests with cameras in a virtual machine that has some.

use anyhow::Result;
use multiscopic_tests::data::{self, Dataset};
use std::env::consts::ARCH;

use crate::{
    command::{built_program, built_test, command, run},
    debian,
    kernel::{self, Kernel},
    layout,
    machine::Machine,
    tool,
};

/// What is run there, one after the other.
const TESTS: [&str; 2] = ["v4l2", "capture_command"];

/// Runs the tests, in release. Where there can be no virtual machine, they are named as ignored.
pub fn run_tests() -> Result<()> {
    if let Some(reason) = missing() {
        println!("v4l2: no virtual machine: {reason}");
        let tests = TESTS.iter().flat_map(|test| ["--test", test]);
        return run(command("cargo", ["test", "--release", "--package", "multiscopic-tests"]).args(tests));
    }
    let mut machine = Machine::new()?;
    let mut script = "cd /tmp; code=0".to_owned();
    let program = built_program("release")?;
    machine.add_program(&program)?;
    machine.add_folder(&layout::root().join("tests/golden"))?;
    let mut variables = format!("MULTISCOPIC_CAMERAS=1 MULTISCOPIC_BINARY='{}'", program.display());
    if let Some(root) = data::root() {
        machine.add_folder(&root.join(Dataset::Tsukuba.name()))?;
        variables += &format!(" MULTISCOPIC_DATA='{}'", root.display());
    }
    for test in TESTS {
        let test = built_test(test)?;
        machine.add_program(&test)?;
        // One after the other: they set what the devices do.
        script += &format!("; {variables} '{}' --test-threads 1 --color never || code=1", test.display());
    }
    machine.run(&(script + "; exit $code"))
}

/// Why there can be no virtual machine here, if so.
fn missing() -> Option<String> {
    if ARCH != "x86_64" || !debian::is_here() {
        return Some("its kernel is Debian's for x86_64, and this is another system".into());
    }
    if debian::can_install() {
        return None;
    }
    let refused = [&tool::QEMU_X86].into_iter().chain(&kernel::TOOLS).find_map(|tool| tool.install().err());
    match Kernel::current() {
        _ if refused.is_some() => refused.map(|refusal| format!("{refusal:#}")),
        None => Some("no list of packages; run `sudo apt-get update` first".into()),
        Some(_) => None,
    }
}
