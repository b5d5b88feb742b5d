//! Firmware that refines disparities with each frame of a sweep: runs it, compares its packets with the host's, and measures it.

use anyhow::{Context, Result, ensure};
use multiscopic::scene::{PinholeCamera, Scene, render_views};
use multiscopic_core::{Disparity, Frame, Rewind, ScanlineSource, SearchSpace, SweepOffset, View, Views};
use multiscopic_edge::{
    Board, Phase, SweepPipeline,
    frame_file::{self, FrameFile},
    packet,
    profile::QQVGA_SWEEP as PARAMS,
};
use std::{convert::Infallible, fs, path::Path, time::Duration};

use crate::{
    counts::{self, Counts},
    emulation::{
        build::{self, Footprint, Program},
        counter::Counter,
        emulated_board::EmulatedBoard,
    },
    firmware_checks::traced_cost::{self, Cost},
    system,
    tools::Toolchain,
};

/// The name of the example, and of its runs.
pub const NAME: &str = "qqvga-sweep";
/// The steps of the unit baseline.
const STEPS: i8 = 16;
/// The most bytes of RAM, statics and stack together.
const RAM: usize = 200 * 1024;

/// A picture in memory.
struct Stored(Vec<u8>);

impl ScanlineSource for Stored {
    type Error = Infallible;

    fn read_line(&mut self, _: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        line.copy_from_slice(&self.0[v * line.len()..][..line.len()]);
        Ok(())
    }
}

impl Rewind for Stored {
    fn rewind(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// This machine as a board.
struct Host;

impl Board for Host {
    type Frames = Stored;
    type Output = Vec<u8>;
    type Error = Infallible;

    fn frames(&mut self, _: &SearchSpace) -> Result<Stored, Infallible> {
        Ok(Stored(Vec::new()))
    }

    fn output(&mut self) -> Result<Vec<u8>, Infallible> {
        Ok(Vec::new())
    }

    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }

    fn enter(_: Phase) {}
}

/// The centre of the demo's scene and the frames of the steps, in the order of the firmware.
fn rendered() -> Vec<(Frame, Vec<u8>)> {
    let mut camera = PinholeCamera::new(PARAMS.search().width() as u32, PARAMS.search().height() as u32);
    camera.baseline_mm /= f64::from(STEPS);
    let steps = (1..=STEPS).flat_map(|step| [step, -step]);
    let views: Vec<View> = steps.filter_map(|step| View::new(step, 0).ok()).collect();
    let mut pictures = Vec::new();
    for views in views.chunks(Views::MAX / 2) {
        let views: Views = views.iter().copied().collect();
        let frames = render_views(&Scene::demo(), &camera, views, 1).frames(views);
        let all = [Frame::Center].into_iter().chain(views.iter().map(Frame::View));
        pictures.extend(all.filter_map(|frame| Some((frame, frames.get(frame)?.as_raw().clone()))));
    }
    let find = |wanted: Frame| pictures.iter().find(|(frame, _)| *frame == wanted).cloned();
    [Frame::Center].into_iter().chain(views.into_iter().map(Frame::View)).filter_map(find).collect()
}

/// The packets that the firmware must send, and the disparities at the end.
fn packets(pictures: &[(Frame, Vec<u8>)]) -> Result<Vec<u8>> {
    let columns = PARAMS.search().width();
    let (mut words, mut line) = (vec![0; SweepPipeline::words(&PARAMS)], vec![None::<Disparity>; columns]);
    let mut buffer = vec![0; packet::buffer_bytes_with_confidences(columns)];
    let mut pipeline = SweepPipeline::new(&PARAMS, &mut words, &mut line, &mut buffer)?;
    let [(_, center), views @ ..] = pictures else { anyhow::bail!("no frames") };
    let (mut center, mut output) = (Stored(center.clone()), Vec::new());
    for (frame, pixels) in views {
        let Frame::View(view) = frame else { continue };
        let bits = i32::from(view.right()) * SweepOffset::STEPS / i32::from(STEPS);
        let offset = SweepOffset::from_bits(bits).context("an offset out of range")?;
        pipeline.refine::<Host>(offset, &mut center, &mut Stored(pixels.clone()))?;
        if view.right() > 0 {
            continue;
        }
        let end = pipeline.send::<Host>(&mut center, &mut output)?.end(None)?.to_vec();
        output.extend(end);
    }
    Ok(output)
}

/// Builds the firmware for these boards, runs it, and reports.
pub fn run(toolchain: &Toolchain, boards: &[&EmulatedBoard], update: bool) -> Result<()> {
    let pictures = rendered();
    let expected = packets(&pictures)?;
    let counter = Counter::build()?;
    let mut counts = Counts::new();
    for board in boards {
        let image = build::build(toolchain, board, &[Program::Example(NAME)])?.pop().context("one program gives one image")?;
        let folder = system::edge_target().join("runs").join(board.name).join(NAME);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for (frame, pixels) in &pictures {
            fs::write(folder.join(FrameFile::new(*frame).name().to_str()?), pixels)?;
        }
        let name = format!("{NAME} on {}", board.name);
        let functions = traced_cost::traced(board, &image, &folder, &counter).with_context(|| format!("edge: {name}"))?;
        let stack = same_lines(&fs::read(folder.join(frame_file::PACKETS.to_str()?))?, &expected).context(name.clone())?;
        let total: Cost = functions.values().copied().sum();
        let frames = (pictures.len() - 1) as f64;
        let pixels = frames * (PARAMS.search().width() * PARAMS.search().height()) as f64;
        traced_cost::print(&name, total, &functions, pixels, "pixel of each frame");
        let statics = Footprint::of(&image)?.ram() as usize;
        println!(
            "edge: {name}: identical to this machine; {:.1} million cycles a frame; RAM {statics} + {stack} bytes",
            total.cycles as f64 / frames / 1e6
        );
        ensure!(statics + stack <= RAM, "{name}: {} bytes of RAM, at most {RAM}", statics + stack);
        let [instructions, cycles] = [total.instructions, total.cycles].map(|count| count as f64 / pixels);
        let numbers = [("instructions per pixel", instructions), ("cycles per pixel", cycles), ("bytes of stack", stack as f64)];
        counts.extend(numbers.into_iter().map(|(what, count)| (format!("{}, {what}", board.name), count)));
    }
    counts::SWEEP.hold(&counts, update, &format!("cargo xtask edge --profile {NAME} --update"))
}

/// Fails unless both have the same packets, but for those that end a frame. Returns the depth of the stack that the last tells.
fn same_lines(found: &[u8], expected: &[u8]) -> Result<usize> {
    let of_frame = PARAMS.search().height() + 1;
    let split = |bytes: &[u8]| bytes.split_inclusive(|&byte| byte == 0).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let (found, expected) = (split(found), split(expected));
    ensure!(found.len() == expected.len(), "{} packets were received, {} were expected", found.len(), expected.len());
    for (n, (found, expected)) in found.chunks(of_frame).zip(expected.chunks(of_frame)).enumerate() {
        super::frames::same_lines(&found.concat(), &expected.concat()).with_context(|| format!("frame {n}"))?;
    }
    let last = found.chunks(of_frame).next_back().context("no frame")?.concat();
    let frame = super::frames::whole(&last, Path::new("the last frame"), PARAMS.search())?;
    frame.stack.context("the firmware did not measure its stack")
}
