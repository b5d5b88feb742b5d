//! Firmware that must fail: each time with a message that names the reason, and with its own exit code.

use anyhow::{Context, Result, bail, ensure};
use multiscopic_core::{Frame, Fusion, View};
use multiscopic_edge::{frame_file::FrameFile, profile};
use std::{
    fs::{self, OpenOptions},
    path::{Path, PathBuf},
};

use crate::{
    emulation::{
        self,
        build::{self, Program},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::frames::ImageSet,
    system::{folders, process},
    tools::toolchain::Toolchain,
};

const FAILED: i32 = 1;
const OVERFLOWED: i32 = 103;

/// Runs every fault.
pub fn run(toolchain: &Toolchain) -> Result<()> {
    too_large(toolchain)?;
    two_boards(toolchain)?;
    for board in &emulated_board::ARM {
        stack_overflow(toolchain, board)?;
    }
    bad_input(toolchain, &emulated_board::REFERENCE)
}

/// An image that needs more RAM than the board has must not link.
fn too_large(toolchain: &Toolchain) -> Result<()> {
    for board in &emulated_board::ARM {
        let output = process::read_failure(&mut build::command(toolchain, board, &[Program::Example("too_large")]))?;
        let reason = output.lines().find(|line| line.contains("will not fit in region 'RAM': overflowed by"));
        let reason = reason.with_context(|| format!("too_large for {} was refused for another reason:\n{output}", board.name))?;
        let from = reason.find("section").unwrap_or_default();
        println!("faults: {} refuses an image that is too large: {}", board.name, &reason[from..]);
    }
    Ok(())
}

/// Firmware for two boards at once must not build.
fn two_boards(toolchain: &Toolchain) -> Result<()> {
    let features = emulated_board::ARM.iter().filter_map(|board| board.feature).collect::<Vec<_>>();
    let [first, second, ..] = features[..] else { bail!("fewer than two boards have features") };
    let mut build = build::command(toolchain, &emulated_board::REFERENCE, &[Program::of(&profile::QQVGA)]);
    let output = process::read_failure(build.arg(format!("--features={first},{second}")))?;
    let reason = output.lines().find(|line| line.contains(&format!("choose the feature {first} or {second}, not both")));
    let reason = reason.with_context(|| format!("{first} with {second} was refused for another reason:\n{output}"))?;
    println!("faults: two boards are refused: {}", reason.trim());
    Ok(())
}

/// Links the matcher alone for every target, which fails if any path leads to a panic.
pub fn no_panic(toolchain: &Toolchain) -> Result<()> {
    for board in emulated_board::ARM.iter().filter(|board| [emulated_board::REFERENCE.name, "an547"].contains(&board.name)) {
        for (program, views) in [(Program::Example("no_panic"), "four"), (Program::ArrayExample("no_panic"), "eight")] {
            process::run(&mut build::command(toolchain, board, &[program]))
                .with_context(|| format!("the matcher of up to {views} views can panic on a {}", board.core))?;
            println!("faults: {}: the matcher of up to {views} views cannot panic", board.name);
        }
    }
    Ok(())
}

/// A stack overflow must end in a named fault, not in overwritten statics.
fn stack_overflow(toolchain: &Toolchain, board: &EmulatedBoard) -> Result<()> {
    let images = build::build(toolchain, board, &[Program::Example("stack_overflow")])?;
    let folder = folder("stack_overflow")?;
    // Boards that have room for the network have more.
    let stack = if board.ram < profile::QQVGA_NET.ram_budget { 8192 } else { 16384 };
    let named = format!("stack overflow: the stack has {stack} bytes");
    images.iter().try_for_each(|image| ends(board, image, "", &folder, OVERFLOWED, &named))
}

/// Missing frames, frames of the wrong size, and an unknown argument.
fn bad_input(toolchain: &Toolchain, board: &EmulatedBoard) -> Result<()> {
    let profile = profile::QQVGA;
    let images = build::build(toolchain, board, &[Program::of(&profile)])?;
    let image = images.first().context("one program gives one image")?;
    let frames = ImageSet::demo(&profile.matching(Fusion::Min));
    let fresh = |name: &str| -> Result<(PathBuf, PathBuf)> {
        let folder = folder(name)?;
        frames.write(&folder)?;
        let left = folder.join(FrameFile::new(Frame::View(View::LEFT)).name().to_str()?);
        Ok((folder, left))
    };
    let (folder, _) = fresh("bad_word")?;
    ends(board, image, "median", &folder, FAILED, "start it with one word: min, mean, heuristic or half")?;
    let (folder, left) = fresh("missing_frame")?;
    fs::remove_file(left)?;
    ends(board, image, "min", &folder, FAILED, "cannot open left.gray")?;
    for (name, bytes) in [("short_frame", 19199), ("long_frame", 19201)] {
        let (folder, left) = fresh(name)?;
        OpenOptions::new().write(true).open(left)?.set_len(bytes)?;
        ends(board, image, "min", &folder, FAILED, &format!("left.gray has {bytes} bytes, a frame of this profile has 19200"))?;
    }
    Ok(())
}

/// Runs `image`, which must end with `code` and a message that contains `message`.
fn ends(board: &EmulatedBoard, image: &Path, arg: &str, folder: &Path, code: i32, message: &str) -> Result<()> {
    let exit = emulation::run(board, image, &[arg], folder, None)?;
    let found = format!("exit code {} and printed:\n{}", exit.code, exit.output);
    ensure!(
        exit.code == code && exit.output.contains(message),
        "expected exit code {code} and {message:?}, the firmware ended with {found}"
    );
    println!("faults: {}: {}", board.name, exit.output.lines().last().unwrap_or_default());
    Ok(())
}

/// An empty working folder.
fn folder(name: &str) -> Result<PathBuf> {
    let folder = folders::edge_target().join("runs").join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}
