//! Firmware that rectifies the frames in its flash: runs it, compares its packets with the host's, and measures it. The frames
//! are those of a camera whose lens distorts and that is turned against its stage.

use anyhow::{Context, Result, ensure};
use image::GrayImage;
use multiscopic::{
    CameraModel, DisparityMap, Frames, Lens, LensModel, Picture,
    files::Limits,
    images::SampledDisplacements,
    lens::Mount,
    scene::{PinholeCamera, Pose, PosedCamera, Scene, Vec3, render_at, trace},
    target::{
        MEASURED,
        reception::{self, ReceivedFrame},
        simulate,
    },
};
use multiscopic_core::{Displacement, DisplacementGrid, Frame, Fusion, Rectification, Rectified, ScanlineSource, View, Views};
use multiscopic_edge::{
    frame_file::{self, FrameFile},
    profile::QQVGA,
};
use multiscopic_reference::rectify;
use std::{
    convert::Infallible,
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
    firmware_checks::frames,
    system::{self, in_parallel},
    tools::Toolchain,
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

/// The size of the frames.
const WIDTH: u16 = 160;
const HEIGHT: u16 = 120;
/// The views.
const VIEWS: Views = Views::HORIZONTAL;
/// Displacements are given at every 16th pixel.
const GRID: DisplacementGrid = DisplacementGrid::new(WIDTH, HEIGHT, 16).expect("a valid grid");
/// The coefficients of the lens: k1, k2, p1, p2, k3. The corners move by 4 pixels.
const DISTORTION: [f64; 5] = [-0.25, 0.06, 0.001, -0.0005, 0.0];
/// The rotation of the camera against its stage, in degrees about the axes to the right, down and ahead.
const TILT_DEG: [f64; 3] = [1.5, -1.0, 2.0];
/// The largest error of the grid in pixels.
const MOST_OFF: f64 = 0.1;

/// Returns the further rotation of the camera at a frame, in degrees about the same axes.
fn turn_deg(frame: Frame) -> [f64; 3] {
    match frame {
        Frame::View(View::LEFT) => [0.3, -0.4, 0.5],
        Frame::View(View::RIGHT) => [-0.4, 0.3, -0.6],
        _ => [0.0; 3],
    }
}

/// A set of frames of the demo's scene.
pub struct DistortedSet {
    /// The frames as the camera took them.
    frames: Frames,
    /// The frames of an ideal camera, for comparison.
    ideal: Frames,
    /// The true disparities of the ideal centre, line by line.
    truth: Vec<Option<f64>>,
    displacements: Vec<(Frame, SampledDisplacements)>,
}

impl DistortedSet {
    /// Renders the set. Other machines may render single grey values differently.
    pub fn render() -> Result<DistortedSet> {
        let (scene, sensor) = (Scene::demo(), PinholeCamera::new(WIDTH.into(), HEIGHT.into()));
        let middle = [WIDTH, HEIGHT].map(|side| (f64::from(side) - 1.0) / 2.0);
        let model = |principal_point, lens| CameraModel { size: None, focal_px: [sensor.focal_px; 2], principal_point, lens };
        let camera = model(middle, Lens::new(LensModel::PlumbBob, &DISTORTION)?);
        // The ideal frames show in their middle what the camera's show there.
        let mount = Mount { rotation_deg: TILT_DEG, ..Mount::SQUARE };
        let ideal = model(mount.principal_point(&camera, [WIDTH.into(), HEIGHT.into()]), Lens::IDEAL);
        let radians = |degrees: [f64; 3]| degrees.map(f64::to_radians);
        let render = |lens, pose: Pose, seed| {
            Picture::Rgb(render_at(&scene, &PosedCamera { sensor, lens: Some(lens), pose }, seed)).to_gray()
        };
        let (mut taken, mut wanted, mut displacements) = (Vec::new(), Vec::new(), Vec::new());
        for (frame, seed) in every_frame().zip(1..) {
            let baselines = match frame {
                Frame::Center => 0,
                Frame::View(view) => view.right(),
            };
            let square = scene.viewpoint.moved([f64::from(baselines) * sensor.baseline_mm, 0.0, 0.0]);
            let turned = square.rotated(radians(turn_deg(frame))).rotated(radians(TILT_DEG));
            taken.push((frame, render(camera, turned, seed)));
            wanted.push((frame, render(ideal, square, seed)));
            let source_of = |pixel| {
                let found = || {
                    let [x, y] = ideal.direction(pixel)?;
                    let Vec3 { x, y, z } = turned.local_direction(square.world_direction(Vec3::new(x, y, 1.0)));
                    camera.pixel([x / z, y / z])
                };
                found().unwrap_or([f64::NAN; 2])
            };
            let sampled = SampledDisplacements::new(GRID, source_of);
            ensure!(sampled.max_error() < MOST_OFF, "the grid of {frame} is off by up to {:.3} px", sampled.max_error());
            displacements.push((frame, sampled));
        }
        let pixels = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (f64::from(u), f64::from(v))));
        let viewer = PosedCamera { sensor, lens: Some(ideal), pose: scene.viewpoint };
        let rays = pixels.map(|(u, v)| viewer.ray(u, v).context("a lens without distortion sees everything"));
        let depths = trace(&scene, &rays.collect::<Result<Vec<_>>>()?);
        let truth = depths.into_iter().map(|depth| Some(sensor.focal_px * sensor.baseline_mm / depth?)).collect();
        Ok(DistortedSet { frames: set(taken)?, ideal: set(wanted)?, truth, displacements })
    }

    /// Writes the frames and the displacements as files that firmware includes. Files that would not change are left alone.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            let is_written = fs::read(&path).is_ok_and(|written| written == bytes);
            let done = if is_written { Ok(()) } else { fs::write(&path, bytes) };
            done.with_context(|| format!("cannot write {}", path.display()))
        };
        for (frame, sampled) in &self.displacements {
            write(FrameFile::new(*frame).name().to_str()?, pixels_of(&self.frames, *frame)?)?;
            let steps = sampled.nodes().iter().flat_map(|node| [node.right, node.down]);
            write(&format!("{frame}.grid"), &steps.flat_map(i16::to_le_bytes).collect::<Vec<u8>>())?;
        }
        Ok(())
    }

    /// The frames, rectified by the core as the matcher reads them. Fails unless they are those of the reference.
    fn rectified(&self) -> Result<Frames> {
        let own = self.own();
        let rectification = self.rectification(&own)?;
        let mut memory = vec![0; rectification.memory(VIEWS).words()];
        let mut source = Rectified::new(Stored(&self.frames), &rectification, VIEWS, &mut memory)?;
        let mut rectified = Vec::new();
        for (frame, sampled) in &self.displacements {
            let mut image = GrayImage::new(WIDTH.into(), HEIGHT.into());
            for (v, line) in image.chunks_exact_mut(WIDTH.into()).enumerate() {
                source.read_line(*frame, v, line)?;
            }
            let nodes: Vec<_> = sampled.nodes().iter().map(|node| (node.right, node.down)).collect();
            let expected = rectify(pixels_of(&self.frames, *frame)?, WIDTH.into(), GRID.spacing(), &nodes);
            ensure!(image.as_raw() == &expected.pixels, "the rectified {frame} is not that of the reference");
            rectified.push((*frame, image));
        }
        set(rectified)
    }

    /// Bytes of the lines that rectified lines are interpolated from, and of the displacements.
    fn bytes(&self) -> Result<[usize; 2]> {
        let own = self.own();
        let nodes = self.displacements.iter().map(|(_, sampled)| size_of_val(sampled.nodes())).sum();
        Ok([self.rectification(&own)?.memory(VIEWS).bytes(), nodes])
    }

    /// The share of pixels whose disparity is within a pixel of the truth.
    fn share_of_truth(&self, disparities: impl Iterator<Item = Option<f64>>) -> f64 {
        let is_near = |(found, truth): (Option<f64>, &Option<f64>)| matches!((found, truth), (Some(found), Some(truth)) if (found - truth).abs() <= 1.0);
        disparities.zip(&self.truth).filter(|&pair| is_near(pair)).count() as f64 / self.truth.len() as f64
    }

    fn own(&self) -> Vec<(Frame, &[Displacement])> {
        self.displacements.iter().map(|(frame, sampled)| (*frame, sampled.nodes())).collect()
    }

    /// The rectification as the firmware has it: the centre's displacements, and those of the views.
    fn rectification<'g>(&self, own: &'g [(Frame, &'g [Displacement])]) -> Result<Rectification<'g>> {
        let ((_, center), views) = own.split_first().context("the centre is the first frame")?;
        Ok(Rectification::new(GRID, center, views)?)
    }
}

/// The centre and the views.
fn every_frame() -> impl Iterator<Item = Frame> {
    [Frame::Center].into_iter().chain(VIEWS.iter().map(Frame::View))
}

/// Frames in the host's type; the centre is the first.
fn set(images: Vec<(Frame, GrayImage)>) -> Result<Frames> {
    let mut images = images.into_iter();
    let (_, center) = images.next().context("the centre is the first frame")?;
    Ok(images.fold(Frames::new(center), |frames, (frame, image)| match frame {
        Frame::View(view) => frames.with(view, image),
        Frame::Center => frames,
    }))
}

fn pixels_of(frames: &Frames, frame: Frame) -> Result<&[u8]> {
    Ok(frames.get(frame).with_context(|| format!("the set has no {frame}"))?.as_raw())
}

/// The lines of frames in memory.
struct Stored<'a>(&'a Frames);

impl ScanlineSource for Stored<'_> {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let image = self.0.get(frame).expect("one of the frames");
        line.copy_from_slice(&image.as_raw()[v * line.len()..][..line.len()]);
        Ok(())
    }
}

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
    set.write(&system::flash_set())?;
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
        let processor = run.board.processor;
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
    if update {
        let mut table = MEASURED.clone();
        for board in boards {
            let counted = counts.get(&format!("{}, instructions per pixel", board.name));
            table.of_mut(board.processor).rectified_pixel = counted.map(|counted| (counted * 10.0).round() / 10.0);
        }
        fs::write(system::root().join("host/src/target/measured.toml"), table.to_toml())?;
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
        let folder = system::edge_target().join("runs").join(self.board.name).join(NAME).join(self.way.argument());
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
