//! Checks of the firmware on emulated boards. Here is small firmware: kernels beside their portable twins, captures on a
//! simulated slide and sensor, with each fault in turn, and what must fail, with a message that names the reason and its own exit
//! code.

pub mod bit_flips;
pub mod c_library;
pub mod cycles;
mod frames;
pub mod price_fit;
pub mod profiles;
pub mod readme;
pub mod rectifying;
pub mod sweeping;
mod traced_cost;

use anyhow::{Context, Result, bail, ensure};
use multiscopic_core::{BlockMatchingParams, Disparity, Frame, Fusion, View};
use multiscopic_edge::{
    Matching,
    frame_file::{self, FrameFile},
    profile::{self, CAPTURE},
};
use std::{
    fs::{self, OpenOptions},
    path::{Path, PathBuf},
};

use self::frames::ImageSet;
use crate::{
    emulation::{
        self,
        build::{self, Program},
        emulated_board::{self, EmulatedBoard},
    },
    system::{self, in_parallel},
    tools::Toolchain,
};

/// Exit code if a capture succeeded. The one after it always must.
const DONE: i32 = 0;
/// Exit code if a capture failed, or the frames could not be matched.
const FAILED: i32 = 1;
/// Exit code after a stack overflow.
const OVERFLOWED: i32 = 103;

/// Compares each processor's kernel with its portable twin, on one board per processor.
pub fn kernels(toolchain: &Toolchain) -> Result<()> {
    for (_, board) in emulated_board::one_per_processor() {
        let folder = system::edge_target().join("runs").join("kernels").join(board.name);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for image in build::build(toolchain, board, &["kernels", "matches", "path_matches"].map(Program::Example))? {
            let exit = emulation::run(board, &image, &[""], &folder, None)?;
            ensure!(exit.code == 0, "a kernel differs from its twin on a {}:\n{}", board.core, exit.output);
            println!("{} on a {}", exit.output.lines().last().unwrap_or_default(), board.core);
        }
    }
    Ok(())
}

/// The programs to begin with, alone, with embassy and with RTIC, print the map of their scene.
pub fn start(toolchain: &Toolchain) -> Result<()> {
    let images = build::build_start(toolchain)?;
    for image in &images {
        let exit = emulation::run(&emulated_board::REFERENCE, image, &[], &folder("start")?, None)?;
        ensure!(exit.code == DONE, "{} ended with exit code {} and printed:\n{}", image.display(), exit.code, exit.output);
        has_map_of_scene(&exit.output).with_context(|| format!("{} of {}", image.display(), build::START))?;
    }
    println!("start: {} programs of {} print the map of their scene", images.len(), build::START);
    Ok(())
}

/// Fails unless the text is the map of a box nine pixels away from its place in the neighbours, before a wall two pixels away: a
/// digit for each fourth pixel of each eighth line.
fn has_map_of_scene(text: &str) -> Result<()> {
    let lines: Vec<&str> = text.lines().collect();
    ensure!(lines.len() == 15, "{} lines instead of 15:\n{text}", lines.len());
    for (v, line) in (4..).step_by(8).zip(lines) {
        for (u, digit) in (2..).step_by(4).zip(line.chars()) {
            // Blocks reach 3 pixels to each side. Beside the box and the frame's borders, no view or one sees what is there.
            let is_inside = |reach: i32| (50 - reach..110 + reach).contains(&u) && (30 - reach..90 + reach).contains(&v);
            let expected = match (is_inside(-3), is_inside(3 + 9), (8..152).contains(&u)) {
                (true, ..) => '9',
                (_, false, true) => '2',
                _ => continue,
            };
            ensure!(digit == expected, "({u}, {v}) is {digit} instead of {expected}:\n{text}");
        }
    }
    Ok(())
}

/// A fault and its expected outcome: the firmware's arguments, its exit code, and a part of its log.
type Case = (&'static str, i32, &'static str);

/// A capture without faults.
const WHOLE: Case = ("nothing 0 once", DONE, "118 lines were sent while the last frame was read out");

/// The faults of captures.
const FAULTS: [Case; 38] = [
    ("pressed 0 once", FAILED, "homing: the switch at the low end of axis y stays pressed"),
    ("released 0 once", FAILED, "homing: the switch at the low end of axis x was not found"),
    ("jam 0 once", FAILED, "homing: the switch at the low end of axis x was not found"),
    ("limit 0 once", FAILED, "the switch at the high end of axis x stopped the motion"),
    ("beyond 0 once", FAILED, "-41000 um along x is beyond -30000..=30000 um"),
    ("slow 0 once", FAILED, "the stage did not arrive within 10 s"),
    ("lost 0 once", FAILED, "the motors lost 400 and 0 steps"),
    ("bumped 1 once", FAILED, "the motors lost -300 and 0 steps"),
    ("model 0 once", FAILED, "frame 0: the sensor is 0x03b0, an HM01B0 is 0x01b0"),
    ("not-started 2 once", DONE, "frame 2 is tried again"),
    ("not-started 2 always", FAILED, "frame 2: the sensor's registers cannot be reached"),
    ("not-started 4 once", DONE, "frame 4 is tried again"),
    ("unreleased 0 once", FAILED, "frame 4: the sensor's registers cannot be reached"),
    ("silent 1 once", DONE, "frame 1 is tried again"),
    ("silent 1 always", FAILED, "frame 1: the camera gave no frame within 0.4 s"),
    ("silent 4 once", DONE, "frame 4 is tried again"),
    ("silent 4 always", FAILED, "frame 4: the camera gave no frame within 0.4 s"),
    ("torn 3 once", DONE, "frame 3 is tried again"),
    ("torn 3 always", FAILED, "frame 3: the frame is torn: it ended after 61 lines"),
    ("torn 4 once", DONE, "frame 4 is tried again"),
    ("torn 4 always", FAILED, "frame 4: the frame is torn: it ended after 61 lines"),
    ("short 4 once", DONE, "frame 4 is tried again"),
    ("short 4 always", FAILED, "frame 4: line 40 of the sensor came with 81 pixels"),
    ("missing 3 once", DONE, "frame 3 is tried again"),
    ("missing 3 always", FAILED, "frame 3: the frame is torn: it ended after 121 lines"),
    ("missing 4 once", DONE, "frame 4 is tried again"),
    ("missing 4 always", FAILED, "frame 4: the frame is torn: it ended after 121 lines"),
    ("doubled 3 once", DONE, "frame 3 is tried again"),
    ("doubled 3 always", FAILED, "frame 3: line 122 of the sensor came with 162 pixels"),
    ("doubled 4 once", DONE, "frame 4 is tried again"),
    ("doubled 4 always", FAILED, "frame 4: line 122 of the sensor came with 162 pixels"),
    ("burst 0 always", FAILED, "frame 0: lines from 6 on came faster than they were taken"),
    ("burst 4 once", DONE, "frame 4 is tried again"),
    ("burst 4 always", FAILED, "frame 4: lines from 6 on came faster than they were taken"),
    ("abort-move 1 once", FAILED, "the capture was aborted"),
    ("abort-settle 2 once", FAILED, "the capture was aborted"),
    ("abort-capture 4 once", FAILED, "the capture was aborted"),
    ("abort-return 0 once", FAILED, "the capture was aborted"),
];

/// A run of the capturing firmware.
struct Capture<'a> {
    board: &'static EmulatedBoard,
    image: &'a Path,
    case: Case,
}

/// A capture without faults on each processor, and every fault on the reference board.
pub fn captures(toolchain: &Toolchain) -> Result<()> {
    let boards = [&emulated_board::REFERENCE, &emulated_board::VECTORS];
    let images = boards.into_iter().map(|board| {
        let image = build::build(toolchain, board, &[Program::Example("capture")])?.pop();
        Ok((board, image.context("one program gives one image")?))
    });
    let images = images.collect::<Result<Vec<_>>>()?;
    let matching = Matching::Blocks { params: CAPTURE, tile_width: CAPTURE.width() };
    let set = ImageSet::tsukuba(&matching).unwrap_or_else(|| ImageSet::demo(&matching));
    let expected = set.disparities(&matching)?;
    let whole = images.iter().map(|(board, image)| Capture { board, image, case: WHOLE });
    let faults = images.iter().take(1).flat_map(|(board, image)| FAULTS.map(|case| Capture { board, image, case }));
    let runs: Vec<_> = whole.chain(faults).collect();
    let messages = in_parallel(&runs, |run| run.check(&set, &expected).with_context(|| format!("capture: {}", run.name())))?;
    for (run, message) in runs.iter().zip(messages) {
        println!("capture: {}: {message}", run.name());
    }
    Ok(())
}

impl Capture<'_> {
    fn name(&self) -> String {
        format!("{} on {}", self.case.0, self.board.name)
    }

    /// Runs it and returns the matching line of its log. Fails unless the outcome is as expected and the
    /// second capture succeeds.
    fn check(&self, set: &ImageSet, expected: &[Option<Disparity>]) -> Result<String> {
        let (arguments, code, message) = self.case;
        let folder = system::edge_target().join("runs/capture").join(self.board.name).join(arguments.replace(' ', "-"));
        if folder.exists() {
            fs::remove_dir_all(&folder)?;
        }
        set.write(&folder)?;
        let args: Vec<&str> = arguments.split(' ').collect();
        let exit = emulation::run(self.board, self.image, &args, &folder, None)?;
        let found = format!("exit code {} and printed:\n{}", exit.code, exit.output);
        ensure!(exit.code == code, "expected exit code {code}, the firmware ended with {found}");
        let line = exit.output.lines().find(|line| line.contains(message));
        let line = line.with_context(|| format!("expected {message:?}, the firmware ended with {found}"))?;
        if code == DONE {
            same(&folder.join(frame_file::PACKETS.to_str()?), &CAPTURE, expected).context("the first capture")?;
        }
        same(&folder.join("again.packets"), &CAPTURE, expected).context("the capture after it")?;
        Ok(line.to_owned())
    }
}

/// Fails unless the packets at `path` are a complete frame of the expected disparities.
fn same(path: &Path, params: &BlockMatchingParams, expected: &[Option<Disparity>]) -> Result<()> {
    let bytes = fs::read(path).with_context(|| format!("the firmware sent no {}", path.display()))?;
    frames::same(&frames::whole(&bytes, path, params.search())?.disparities, expected)
}

/// Runs firmware that must fail: what differs between boards on `boards`, the rest on the reference board.
pub fn faults(toolchain: &Toolchain, boards: &[EmulatedBoard]) -> Result<()> {
    too_large(toolchain, boards)?;
    two_boards(toolchain)?;
    boards.iter().try_for_each(|board| stack_overflow(toolchain, board))?;
    bad_input(toolchain, &emulated_board::REFERENCE)
}

/// An image that needs more RAM than the board has must not link.
fn too_large(toolchain: &Toolchain, boards: &[EmulatedBoard]) -> Result<()> {
    for board in boards {
        let output = system::read_failure(&mut build::command(toolchain, board, &[Program::Example("too_large")]))?;
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
    let mut build = build::command(toolchain, &emulated_board::REFERENCE, &[Program::of(&profile::QQVGA, Fusion::Min)]);
    let output = system::read_failure(build.arg(format!("--features={first},{second}")))?;
    let reason = output.lines().find(|line| line.contains(&format!("choose the feature {first} or {second}, not both")));
    let reason = reason.with_context(|| format!("{first} with {second} was refused for another reason:\n{output}"))?;
    println!("faults: two boards are refused: {}", reason.trim());
    Ok(())
}

/// Links the matcher alone, which fails if any path leads to a panic: for the reference board, optimised as firmware is and for
/// its size; or with all views for both Arm targets, at each level.
pub fn no_panic(toolchain: &Toolchain, with_all: bool) -> Result<()> {
    let few = (Program::Example("no_panic"), "four");
    let many = (Program::ArrayExample("no_panic"), "eight");
    let (reference, vectors) = (&emulated_board::REFERENCE, &emulated_board::VECTORS);
    let all = [(reference, few), (vectors, many), (reference, many), (vectors, few)];
    let levels = ["3", "\"s\"", "2"];
    let (programs, levels) = if with_all { (&all[..], &levels[..]) } else { (&all[..1], &levels[..2]) };
    for ((board, (program, views)), level) in programs.iter().flat_map(|program| levels.iter().map(move |level| (program, level)))
    {
        let mut build = build::command(toolchain, board, &[*program]);
        system::run(build.arg(format!("--config=profile.firmware.opt-level={level}")))
            .with_context(|| format!("at level {level}, the matcher of up to {views} views can panic on a {}", board.core))?;
        println!("faults: {}: at level {level}, the matcher of up to {views} views cannot panic", board.name);
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
    images.iter().try_for_each(|image| ends(board, image, &folder, OVERFLOWED, &named))
}

/// Missing frames and frames of the wrong size.
fn bad_input(toolchain: &Toolchain, board: &EmulatedBoard) -> Result<()> {
    let profile = profile::QQVGA;
    let images = build::build(toolchain, board, &[Program::of(&profile, Fusion::Min)])?;
    let image = images.first().context("one program gives one image")?;
    let frames = ImageSet::demo(&profile.matching(Fusion::Min));
    let fresh = |name: &str| -> Result<(PathBuf, PathBuf)> {
        let folder = folder(name)?;
        frames.write(&folder)?;
        let left = folder.join(FrameFile::new(Frame::View(View::LEFT)).name().to_str()?);
        Ok((folder, left))
    };
    let (folder, left) = fresh("missing_frame")?;
    fs::remove_file(left)?;
    ends(board, image, &folder, FAILED, "cannot open left.gray")?;
    for (name, bytes) in [("short_frame", 19199), ("long_frame", 19201)] {
        let (folder, left) = fresh(name)?;
        OpenOptions::new().write(true).open(left)?.set_len(bytes)?;
        ends(board, image, &folder, FAILED, &format!("left.gray has {bytes} bytes, a frame of this profile has 19200"))?;
    }
    Ok(())
}

/// Runs `image`, which must end with `code` and a message that contains `message`.
fn ends(board: &EmulatedBoard, image: &Path, folder: &Path, code: i32, message: &str) -> Result<()> {
    let exit = emulation::run(board, image, &[], folder, None)?;
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
    let folder = system::edge_target().join("runs").join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}
