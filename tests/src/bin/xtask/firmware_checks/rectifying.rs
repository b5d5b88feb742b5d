//! Runs the firmware that rectifies the frames in its flash, compares its packets with the host's, and measures it.

use anyhow::{Context, Result, ensure};
use multiscopic::{
    DisparityMap,
    files::Limits,
    target::{
        MEASURED,
        reception::{self, ReceivedFrame},
        simulate,
    },
};
use multiscopic_core::Fusion;
use multiscopic_edge::{frame_file, profile::QQVGA};
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    counts::{self, Counts},
    emulation::{
        self,
        build::{self, Footprint, Program},
        counter::{Counter, Instructions},
        emulated_board::EmulatedBoard,
    },
    firmware_checks::{distorted_set::DistortedSet, frames},
    system::{folders, in_parallel},
    tools::toolchain::Toolchain,
};

/// The name of the example, and of its runs.
pub const NAME: &str = "qqvga-rectified";
/// The fusion of its matches.
pub const FUSION: Fusion = Fusion::Min;
/// Bytes of the word beside the lines that notes whether they are lent.
const FLAG: usize = 4;
/// The most by which the share of pixels near the truth may be smaller than that of an ideal camera's frames.
const MOST_LOST: f64 = 0.05;
/// The largest share of them without rectification.
const MOST_WITHOUT: f64 = 0.5;

/// The way that the firmware is to match the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Rectified,
    Plain,
}

impl Way {
    const ALL: [Way; 2] = [Way::Rectified, Way::Plain];

    /// The firmware's argument.
    const fn argument(self) -> &'static str {
        match self {
            Way::Rectified => "rectified",
            Way::Plain => "plain",
        }
    }
}

/// A firmware image and its run.
struct Run<'a> {
    board: &'static EmulatedBoard,
    image: PathBuf,
    way: Way,
    /// The packets that the host makes of the same frames.
    expected: &'a [u8],
}

/// The measurements of a run.
struct Measurement {
    statics: usize,
    stack: usize,
    instructions: Instructions,
}

/// Renders a set, builds firmware with it in flash, runs it on `boards`, and compares or records the cost.
pub fn run(toolchain: &Toolchain, boards: &[&'static EmulatedBoard], update: bool) -> Result<()> {
    let set = DistortedSet::render()?;
    set.write(&folders::flash_set())?;
    let expected = [host_packets(&set, Way::Rectified)?, host_packets(&set, Way::Plain)?];
    check_quality(&set, &expected)?;
    let counter = Counter::build()?;
    let mut runs = Vec::new();
    for board in boards {
        let image =
            build::build(toolchain, board, &[Program::FlashExample(NAME)])?.pop().context("one program gives one image")?;
        let ways = Way::ALL.into_iter().zip(&expected);
        runs.extend(ways.map(|(way, expected)| Run { board, image: image.clone(), way, expected }));
    }
    let measurements = in_parallel(&runs, |run| run.measure(&counter).with_context(|| format!("edge: {}", run.name())))?;
    let [lines, displacements] = set.bytes()?;
    let mut counts = Counts::new();
    for (pair, measured) in runs.chunks_exact(2).zip(measurements.chunks_exact(2)) {
        let ([run, _], [rectified, plain]) = (pair, measured) else { continue };
        let processor = run.board.processor.context("there are no budgets for the board")?;
        let workspace = processor.lengths(&QQVGA.matching(FUSION)).bytes();
        let formula = workspace + lines + FLAG + MEASURED.of(processor).statics;
        ensure!(
            rectified.statics == formula,
            "{}: {} bytes of statics, the formula says {formula}",
            run.name(),
            rectified.statics
        );
        let pixels = 3 * QQVGA.matching(FUSION).search().width() * QQVGA.matching(FUSION).search().height();
        let fetching = |m: &Measurement| m.instructions.fetching as f64 / pixels as f64;
        let cost = fetching(rectified) - fetching(plain);
        println!(
            "edge: {}: identical to this machine; {cost:.1} instructions a pixel of each frame ({:.1} with reading, {:.1} without \
             rectification); RAM {} + {} bytes, of which lines {lines}; displacements {displacements} bytes of flash",
            run.name(),
            fetching(rectified),
            fetching(plain),
            rectified.statics,
            rectified.stack,
        );
        let numbers = [("instructions per pixel", cost), ("bytes of lines", lines as f64)];
        let bytes = [("bytes of statics", rectified.statics as f64), ("bytes of stack", rectified.stack as f64)];
        let named = numbers.into_iter().chain(bytes);
        counts.extend(named.map(|(what, count)| (format!("{}, {what}", run.board.name), count)));
    }
    counts::RECTIFICATION.hold(&counts, update, &format!("cargo xtask edge --profile {NAME} --update"))
}

/// Computes the packets that the firmware must send.
fn host_packets(set: &DistortedSet, way: Way) -> Result<Vec<u8>> {
    let frames = match way {
        Way::Rectified => &set.rectified()?,
        Way::Plain => &set.frames,
    };
    Ok(simulate(&QQVGA, FUSION, &frames.planes(), &|| ())?.packets)
}

/// Fails unless disparities are near the truth if frames are rectified, and only then.
fn check_quality(set: &DistortedSet, [rectified, plain]: &[Vec<u8>; 2]) -> Result<()> {
    let share = |packets: &[u8]| -> Result<f64> { Ok(set.share_of_truth(pixels(&frame(packets)?.disparities))) };
    let [ideal, rectified, plain] =
        [share(&simulate(&QQVGA, FUSION, &set.ideal.planes(), &|| ())?.packets)?, share(rectified)?, share(plain)?];
    println!(
        "edge: {NAME}: within 1 px of the truth: {:.1} % of the pixels; {:.1} % without rectification, {:.1} % of an ideal camera",
        100.0 * rectified,
        100.0 * plain,
        100.0 * ideal
    );
    ensure!(rectified > ideal - MOST_LOST, "rectified frames have more errors than those of an ideal camera");
    ensure!(plain < MOST_WITHOUT, "the frames match without rectification too, so they test nothing");
    Ok(())
}

/// The frame that packets hold.
fn frame(packets: &[u8]) -> Result<ReceivedFrame> {
    Ok(reception::receive(&mut &packets[..], Path::new("simulation"), Limits::DEFAULT, |_| ())?)
}

fn pixels(disparities: &DisparityMap) -> impl Iterator<Item = Option<f64>> {
    disparities.pixels().iter().map(|disparity| disparity.map(|disparity| f64::from(disparity.to_bits()) / 64.0))
}

impl Run<'_> {
    fn name(&self) -> String {
        format!("{NAME} on {}, {}", self.board.name, self.way.argument())
    }

    /// Runs the image and measures it. Fails unless its packets equal the host's.
    fn measure(&self, counter: &Counter) -> Result<Measurement> {
        let folder = folders::edge_target().join("runs").join(self.board.name).join(NAME).join(self.way.argument());
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let packets = folder.join(frame_file::PACKETS.to_str()?);
        if packets.exists() {
            fs::remove_file(&packets)?;
        }
        let plugin = counter.plugin(&self.image)?;
        let exit = emulation::run(self.board, &self.image, &[self.way.argument()], &folder, Some(&plugin))?;
        ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
        let bytes = fs::read(&packets).with_context(|| format!("the firmware sent no {}", packets.display()))?;
        let frame = frames::whole(&bytes, &packets, QQVGA.matching(FUSION).search())?;
        frames::same_lines(&bytes, self.expected)?;
        Ok(Measurement {
            statics: Footprint::of(&self.image)?.ram() as usize,
            stack: frame.stack.context("the firmware did not measure its stack")?,
            instructions: Instructions::read(&folder)?,
        })
    }
}
