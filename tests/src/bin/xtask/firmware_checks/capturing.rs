//! Runs the capturing firmware on a simulated slide and sensor: without faults, and with each fault in turn.

use anyhow::{Context, Result, ensure};
use multiscopic_core::{BlockMatchingParams, Disparity};
use multiscopic_edge::{Matching, frame_file, profile::CAPTURE};
use std::{fs, path::Path};

use crate::{
    emulation::{
        self,
        build::{self, Program},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::frames::{self, ImageSet},
    system::{folders, in_parallel},
    tools::toolchain::Toolchain,
};

/// Exit code if the first capture succeeded. The second always must.
const DONE: i32 = 0;
/// Exit code if the first capture failed.
const FAILED: i32 = 1;

/// A fault and its expected outcome: the firmware's arguments, its exit code, and a part of its log.
type Case = (&'static str, i32, &'static str);

/// A capture without faults.
const WHOLE: Case = ("nothing 0 once", DONE, "118 lines were sent while the last frame was read out");

/// The faults.
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

/// A run of the firmware.
struct Run<'a> {
    board: &'static EmulatedBoard,
    image: &'a Path,
    case: Case,
}

/// A capture without faults on each processor, and every fault on the reference board.
pub fn run(toolchain: &Toolchain) -> Result<()> {
    let boards = [&emulated_board::REFERENCE, &emulated_board::VECTORS];
    let images = boards.into_iter().map(|board| {
        let image = build::build(toolchain, board, &[Program::Example("capture")])?.pop();
        Ok((board, image.context("one program gives one image")?))
    });
    let images = images.collect::<Result<Vec<_>>>()?;
    let matching = Matching::Blocks { params: CAPTURE, tile_width: CAPTURE.width() };
    let set = ImageSet::tsukuba(&matching).unwrap_or_else(|| ImageSet::demo(&matching));
    let expected = set.disparities(&matching)?;
    let whole = images.iter().map(|(board, image)| Run { board, image, case: WHOLE });
    let faults = images.iter().take(1).flat_map(|(board, image)| FAULTS.map(|case| Run { board, image, case }));
    let runs: Vec<_> = whole.chain(faults).collect();
    let messages = in_parallel(&runs, |run| run.check(&set, &expected).with_context(|| format!("capture: {}", run.name())))?;
    for (run, message) in runs.iter().zip(messages) {
        println!("capture: {}: {message}", run.name());
    }
    Ok(())
}

impl Run<'_> {
    fn name(&self) -> String {
        format!("{} on {}", self.case.0, self.board.name)
    }

    /// Runs it and returns the matching line of its log. Fails unless the outcome is as expected and the
    /// second capture succeeds.
    fn check(&self, set: &ImageSet, expected: &[Option<Disparity>]) -> Result<String> {
        let (arguments, code, message) = self.case;
        let folder = folders::edge_target().join("runs/capture").join(self.board.name).join(arguments.replace(' ', "-"));
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
