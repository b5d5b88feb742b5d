//! Installs what building and running the firmware needs, or explains how to.

use anyhow::{Context, Result};

use crate::{
    emulation::emulated_board,
    tools::{self, toolchain::Toolchain},
};

/// Makes sure that every tool and target is installed.
pub fn run() -> Result<Toolchain> {
    for tool in &tools::ALL {
        eprintln!("setup: {}", tool.install()?);
    }
    let toolchain = toolchain()?;
    eprintln!("setup: {} from {toolchain}", emulated_board::targets().join(", "));
    Ok(toolchain)
}

/// The toolchain for the boards with Arm processors.
pub fn toolchain() -> Result<Toolchain> {
    Toolchain::install(&emulated_board::targets()).context("setup: the Rust targets of the boards")
}
