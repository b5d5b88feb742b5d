//! Installs what the firmware's build and run need, where it can, and says what to do where it cannot.

use anyhow::{Context, Result};

use crate::{
    emulation::emulated_board,
    tools::{tool, toolchain::Toolchain},
};

/// Makes sure that every tool and every target is there.
pub fn run() -> Result<Toolchain> {
    for tool in &tool::ALL {
        eprintln!("setup: {}", tool.install()?);
    }
    let targets = emulated_board::targets();
    let toolchain = Toolchain::install(&targets).context("setup: the Rust targets of the boards")?;
    eprintln!("setup: {} from {toolchain}", targets.join(", "));
    Ok(toolchain)
}
