//! Frames of a camera whose lens distorts and that is turned against its stage, and where their rectified pixels are found.

use anyhow::{Context, Result, ensure};
use image::GrayImage;
use multiscopic::{
    CameraModel, Frames, Lens, LensModel, Picture,
    images::SampledDisplacements,
    lens::Mount,
    scene::{PinholeCamera, Pose, PosedCamera, Scene, Vec3, render_at, trace},
};
use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification, Rectified, ScanlineSource, View, Views};
use multiscopic_edge::frame_file::FrameFile;
use multiscopic_reference::rectify;
use std::{convert::Infallible, fs, path::Path};

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
    pub frames: Frames,
    /// The frames of an ideal camera, for comparison.
    pub ideal: Frames,
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
        for (frame, seed) in frames().zip(1..) {
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
            write(FrameFile::new(*frame).name().to_str()?, pixels(&self.frames, *frame)?)?;
            let steps = sampled.nodes().iter().flat_map(|node| [node.right, node.down]);
            write(&format!("{frame}.grid"), &steps.flat_map(i16::to_le_bytes).collect::<Vec<u8>>())?;
        }
        Ok(())
    }

    /// The frames, rectified by the core as the matcher reads them. Fails unless they are those of the reference.
    pub fn rectified(&self) -> Result<Frames> {
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
            let expected = rectify(pixels(&self.frames, *frame)?, WIDTH.into(), GRID.spacing(), &nodes);
            ensure!(image.as_raw() == &expected.pixels, "the rectified {frame} is not that of the reference");
            rectified.push((*frame, image));
        }
        set(rectified)
    }

    /// Bytes of the lines that rectified lines are interpolated from, and of the displacements.
    pub fn bytes(&self) -> Result<[usize; 2]> {
        let own = self.own();
        let nodes = self.displacements.iter().map(|(_, sampled)| size_of_val(sampled.nodes())).sum();
        Ok([self.rectification(&own)?.memory(VIEWS).bytes(), nodes])
    }

    /// The share of pixels whose disparity is within a pixel of the truth.
    pub fn share_of_truth(&self, disparities: impl Iterator<Item = Option<f64>>) -> f64 {
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
fn frames() -> impl Iterator<Item = Frame> {
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

fn pixels(frames: &Frames, frame: Frame) -> Result<&[u8]> {
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
