//! Builds the firmware.

use anyhow::Result;
use std::path::PathBuf;

use crate::{board::Board, command::run, layout, toolchain::Toolchain};

/// The arguments that select the firmware for `board`.
pub fn selection(board: &Board) -> [&str; 7] {
    ["--release", "--target", board.target, "--package", "multiscopic-edge", "--bin", "firmware"]
}

/// Builds the firmware for `board`, and says where it is.
pub fn build(toolchain: &Toolchain, board: &Board) -> Result<PathBuf> {
    run(toolchain.cargo("build").args(selection(board)))?;
    Ok(layout::edge_target().join(board.target).join("release/firmware"))
}
