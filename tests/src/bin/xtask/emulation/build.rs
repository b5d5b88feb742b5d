//! Builds the firmware.

use anyhow::{Context, Result};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    emulation::emulated_board::EmulatedBoard,
    system::{folders, process::run},
    tools::toolchain::Toolchain,
};

/// A program of the firmware's crate.
#[derive(Clone, Copy)]
pub enum Program {
    /// The firmware of a profile.
    Profile(&'static str),
    /// An example.
    Example(&'static str),
}

/// The cargo command that builds `programs` for `board`.
pub fn command(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Command {
    let mut cargo = toolchain.cargo("build");
    cargo.args(["--profile", "firmware", "--package", "multiscopic-firmware", "--target", board.target]);
    cargo.env("RUSTFLAGS", board.rustflags);
    cargo.args(board.feature.map(|feature| format!("--features={feature}")));
    cargo.args(programs.iter().map(|program| match program {
        Program::Profile(name) => format!("--bin={name}"),
        Program::Example(name) => format!("--example={name}"),
    }));
    cargo
}

/// Builds `programs` for `board`, and returns their paths.
pub fn build(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Result<Vec<PathBuf>> {
    run(&mut command(toolchain, board, programs))?;
    let built = folders::edge_target().join(board.target).join("firmware");
    // Keep copies: the next board's images have the same paths.
    let kept = folders::edge_target().join("images").join(board.name);
    fs::create_dir_all(&kept)?;
    programs.iter().map(|program| keep(&built, &kept, *program)).collect()
}

fn keep(built: &Path, kept: &Path, program: Program) -> Result<PathBuf> {
    let (from, to) = match program {
        Program::Profile(name) => (built.join(name), kept.join(name)),
        Program::Example(name) => (built.join("examples").join(name), kept.join(name)),
    };
    fs::copy(&from, &to).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(to)
}
