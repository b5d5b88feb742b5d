//! Compares each processor's kernel with its portable twin on the emulated processor.

use anyhow::{Context, Result, ensure};
use std::fs;

use crate::{
    emulation::{
        self,
        build::{self, Program},
        emulated_board,
    },
    system::folders,
    tools::toolchain::Toolchain,
};

/// Runs the comparison on one board per processor.
pub fn run(toolchain: &Toolchain) -> Result<()> {
    for (_, board) in emulated_board::one_per_processor() {
        let folder = folders::edge_target().join("runs").join("kernels").join(board.name);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for image in build::build(toolchain, board, &["kernels", "matches", "path_matches"].map(Program::Example))? {
            let exit = emulation::run(board, &image, &[""], &folder, None)?;
            ensure!(exit.code == 0, "a kernel differs from its twin on a {}:\n{}", board.core, exit.output);
            println!("{} on a {}", exit.output.lines().last().unwrap_or_default(), board.core);
        }
    }
    Ok(())
}
