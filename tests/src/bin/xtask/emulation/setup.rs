//! Installs what building and running the firmware needs, or explains how to.

use anyhow::{Context, Result};

use crate::{
    emulation::emulated_board,
    tools::{tool, toolchain::Toolchain},
};

/// Makes sure that every tool and target is installed.
pub fn run() -> Result<Toolchain> {
    for tool in &tool::ALL {
        eprintln!("setup: {}", tool.install()?);
    }
    let targets = emulated_board::targets();
    let toolchain = Toolchain::install(&targets).context("setup: the Rust targets of the boards")?;
    eprintln!("setup: {} from {toolchain}", targets.join(", "));
    Ok(toolchain)
}
