//! The firmware for a Raspberry Pi Pico 2 with a HAL of its own, which is linted and linked but has no board to run on here.

use anyhow::{Result, ensure};
use std::process::Command;

use crate::{
    emulation::build::Footprint,
    system::{folders, process::run},
    tools::toolchain::Toolchain,
};

/// The target of its processor.
const TARGET: &str = "thumbv8m.main-none-eabihf";

/// Bytes of the RAM that memory.x gives it.
const RAM: u64 = 512 * 1024;

/// Bytes that have to be left for the stack: twice as much as that of the emulated boards.
const STACK: u64 = 16 * 1024;

/// Its manifest, in the workspace.
pub const MANIFEST: &str = "edge/pico2/Cargo.toml";

/// Lints it.
pub fn lint(toolchain: &Toolchain) -> Result<()> {
    run(cargo(toolchain, "clippy").args(["--", "-Dwarnings"]))
}

/// Links it as its readme says, and fails if its statics leave too little RAM for the stack.
pub fn build(toolchain: &Toolchain) -> Result<()> {
    run(&mut cargo(toolchain, "build"))?;
    let footprint = Footprint::of(&folders::edge_target().join(TARGET).join("release/multiscopic-pico2"))?;
    ensure!(footprint.ram() + STACK <= RAM, "{footprint}: fewer than {STACK} bytes are left for the stack");
    println!("pico2: {footprint}, {} B left for the stack", RAM - footprint.ram());
    Ok(())
}

/// The cargo command `verb` in its folder, whose configuration names the target and the processor.
fn cargo(toolchain: &Toolchain, verb: &str) -> Command {
    let mut cargo = toolchain.cargo(verb);
    cargo.args(["--release", "--locked"]).current_dir(folders::root().join("edge/pico2"));
    cargo
}
