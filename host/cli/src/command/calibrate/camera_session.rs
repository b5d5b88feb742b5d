//! Pictures of a board, taken by a camera whenever the board is in a new pose.

use std::{
    convert::Infallible,
    fs, mem,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use image::GrayImage;
use multiscopic::{
    CameraModel, Error, Lens, Picture, Raster, Result,
    calibration::{ArmPose, BoardCorner, BoardImage, Coverage, PrintedBoard},
    capture::{BlockingCamera, Imperfections, stage::PoseReader},
    images::Transform,
};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::command::{
    advice,
    cameras::{AnyCamera, UnlockedNote},
    options::{CameraSpec, SettingsOptions},
    terminal::{self, signals},
};

/// Width and height of a simulated camera's pictures, and their focal length in widths, unless its lens has others.
const SIMULATED_SIZE: [usize; 2] = [640, 480];
const SIMULATED_FOCAL: f64 = 1.5;
/// A pose is new if the corners are this far from where they were in each picture before, as a share of the image's diagonal.
const NEW_POSE: f64 = 0.06;
/// The board stands still if its corners move by at most this many pixels from one picture to the next.
const STILL_PX: f64 = 1.0;
/// A pose of the tool is new if it is turned by this much against each before.
const NEW_TURN_DEG: f64 = 8.0;
/// The tool is turned enough about an axis if it was by this much.
const ENOUGH_TURN_DEG: f64 = 20.0;
/// The arm stands still if its tool moves by less than this while a picture is taken.
const STILL_MM: f64 = 0.1;
const STILL_DEG: f64 = 0.02;
/// The number of pictures without a new pose after which the session ends.
const MOST_TRIALS: u32 = 3000;

/// Pictures to be taken.
pub struct CameraSession<'a> {
    pub board: &'a PrintedBoard,
    /// The number of pictures to take.
    pub pictures: usize,
    /// A new folder for them, and for the poses of an arm.
    pub keep: Option<&'a Path>,
}

/// The boards that the pictures show.
struct Taken<'a> {
    session: &'a CameraSession<'a>,
    size: [usize; 2],
    images: Vec<BoardImage>,
    /// The poses of the tool, if an arm carries the camera.
    poses: Vec<ArmPose>,
    /// The last message, which is said once.
    said: String,
}

impl CameraSession<'_> {
    /// Takes pictures until there are enough, or the user presses Ctrl-C: whenever the board is in a new pose, or the `arm` that
    /// carries the camera. Returns the boards and the size of the pictures.
    pub fn run(
        &self,
        camera: &CameraSpec,
        settings: &SettingsOptions,
        arm: Option<PoseReader>,
    ) -> Result<(Vec<BoardImage>, [usize; 2])> {
        if let Some(folder) = self.keep {
            fs::create_dir(folder).map_err(|source| Error::Write { path: folder.into(), source })?;
        }
        let timeout = settings.frame_timeout()?;
        match camera {
            CameraSpec::Real(source) => {
                let note = UnlockedNote::default();
                let mut camera = AnyCamera::open(source, settings, &note)?;
                let (_, size) = camera.describe(timeout)?;
                let mut is_warned = false;
                self.take(size.map(|side| side as usize), true, arm, |cancelled| {
                    let picture = camera.take(timeout, cancelled)?;
                    if let Some(note) = note.get().filter(|_| !mem::replace(&mut is_warned, true)) {
                        terminal::warn(note);
                    }
                    Ok(picture)
                })
            }
            CameraSpec::Simulated(_) if arm.is_some() => {
                Err(Error::Usage("a simulated camera does not see a board from an arm: give a real one, or exec:".into()))
            }
            CameraSpec::Simulated(file) => {
                let lens = match file {
                    Some(file) => Imperfections::read(file)?.lens,
                    None => None,
                };
                let asked = settings.settings().size.map(|size| size.map(|side| side as usize));
                let size = asked.or(lens.and_then(|lens| lens.size)).unwrap_or(SIMULATED_SIZE);
                if let (Some(lens), Some(path)) = (&lens, file) {
                    lens.check_size(path, size)?;
                }
                let pinhole = CameraModel {
                    size: Some(size),
                    focal_px: [SIMULATED_FOCAL * size[0] as f64; 2],
                    principal_point: size.map(|side| (side as f64 - 1.0) / 2.0),
                    lens: Lens::IDEAL,
                };
                let mut camera = SimulatedBoard::new(self.board, &lens.unwrap_or(pinhole), size);
                self.take(size, false, None, |cancelled| camera.take(Duration::MAX, cancelled).map_err(|never| match never {}))
            }
        }
    }

    fn take(
        &self,
        size: [usize; 2],
        is_live: bool,
        mut arm: Option<PoseReader>,
        mut take: impl FnMut(&AtomicBool) -> Result<Picture>,
    ) -> Result<(Vec<BoardImage>, [usize; 2])> {
        // The first Ctrl-C ends the session, the second the program.
        let interrupts = signals::count(2);
        let never = AtomicBool::new(false);
        let mut taken = Taken { session: self, size, images: Vec::new(), poses: Vec::new(), said: String::new() };
        let mut previous: Vec<BoardCorner> = Vec::new();
        let mut trials = 0;
        while taken.images.len() < self.pictures && interrupts.load(Ordering::Relaxed) == 0 && trials < MOST_TRIALS {
            trials += 1;
            let mut tool = || arm.as_mut().map(|arm| arm.pose().map_err(Error::from)).transpose();
            let before = tool()?;
            let picture = take(&never)?;
            let tool = tool()?;
            let corners = match self.board.corners_in(&picture.to_gray()) {
                Ok(corners) => corners,
                Err(miss) => {
                    taken.say(advice::board_miss(&miss));
                    continue;
                }
            };
            let is_still = before.zip(tool).is_none_or(|(before, after)| is_at_rest(&before, &after))
                && (!is_live || motion(&corners, &previous).is_some_and(|motion| motion < STILL_PX));
            let is_new = tool.map_or_else(|| taken.is_new(&corners), |tool| taken.is_turned(&tool));
            match (is_new, is_still) {
                (true, true) => {
                    taken.keep(picture, corners.clone(), tool)?;
                    trials = 0;
                }
                (true, false) => taken.say(if tool.is_some() { "hold the arm still" } else { "hold the board still" }.into()),
                (false, _) => taken.say(taken.next()),
            }
            previous = corners;
        }
        Ok((taken.images, size))
    }
}

impl Taken<'_> {
    fn is_new(&self, corners: &[BoardCorner]) -> bool {
        let diagonal = (self.size[0] as f64).hypot(self.size[1] as f64);
        let is_other = |image: &BoardImage| motion(corners, &image.corners).is_none_or(|motion| motion > NEW_POSE * diagonal);
        self.images.iter().all(is_other)
    }

    /// True if the tool is turned against all poses that were taken.
    fn is_turned(&self, tool: &Transform) -> bool {
        self.poses.iter().all(|pose| angle_deg(&(pose.tool.inverse() * *tool)) > NEW_TURN_DEG)
    }

    fn keep(&mut self, picture: Picture, corners: Vec<BoardCorner>, tool: Option<Transform>) -> Result<()> {
        let name = format!("{:02}.png", self.images.len() + 1);
        if let Some(folder) = self.session.keep {
            picture.write_png(&folder.join(&name))?;
        }
        self.poses.extend(tool.map(|tool| ArmPose { picture: name.clone().into(), tool }));
        if let (Some(folder), Some(_)) = (self.session.keep, tool) {
            ArmPose::write_all(&self.poses, &folder.join(ArmPose::FILE_NAME))?;
        }
        self.images.push(BoardImage { name, corners });
        let message = format!("picture {} of {}; {}", self.images.len(), self.session.pictures, self.next());
        self.say(message);
        Ok(())
    }

    /// Returns advice on the next picture.
    fn next(&self) -> String {
        if let Some(first) = self.poses.first() {
            let turns = self.poses.iter().map(|pose| (first.tool.inverse() * pose.tool).rotation_deg);
            let spread = |axis: usize| turns.clone().map(|turn| turn[axis].abs()).fold(0.0, f64::max);
            let missing: Vec<&str> =
                (0..3).filter(|&axis| spread(axis) < ENOUGH_TURN_DEG).map(|axis| ["x", "y", "z"][axis]).collect();
            return match missing.is_empty() {
                true => "turn the tool otherwise, and look at the board from elsewhere".into(),
                false => format!("turn the tool by 20 to 40 degrees about its {}", missing.join(", and then about its ")),
            };
        }
        let pixels = self.images.iter().flat_map(|image| &image.corners).map(|corner| corner.pixel);
        let missing = Coverage::new(self.size, pixels).missing();
        match missing.is_empty() {
            true => "tilt the board, and move it nearer or away".into(),
            false => format!("tilt the board, and move it to these parts of the image: {}", missing.join(", ")),
        }
    }

    fn say(&mut self, message: String) {
        if message != self.said {
            terminal::say(&message);
            self.said = message;
        }
    }
}

/// The angle of a rotation in degrees.
fn angle_deg(Transform { rotation_deg, .. }: &Transform) -> f64 {
    rotation_deg.iter().map(|turn| turn * turn).sum::<f64>().sqrt()
}

/// True if a tool has not moved from one pose to the other.
fn is_at_rest(before: &Transform, after: &Transform) -> bool {
    let moved = before.inverse() * *after;
    moved.translation_mm.iter().all(|mm| mm.abs() < STILL_MM) && angle_deg(&moved) < STILL_DEG
}

/// The mean distance in pixels between the corners that both images show. `None` if there are none.
fn motion(corners: &[BoardCorner], others: &[BoardCorner]) -> Option<f64> {
    let distance = |corner: &BoardCorner| {
        let other = others.iter().find(|other| other.board_mm == corner.board_mm)?;
        Some((corner.pixel[0] - other.pixel[0]).hypot(corner.pixel[1] - other.pixel[1]))
    };
    let distances: Vec<f64> = corners.iter().filter_map(distance).collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

/// Pixels of the board for a millimetre.
const PER_MM: f64 = 4.0;
/// Samples of a pixel along each side.
const SAMPLES: usize = 6;
/// The share of the image's width that the board has.
const BOARD_SHARE: f64 = 0.6;
/// Grey values of black, of white, and of what is behind the board, and the standard deviation of their noise.
const BLACK: f64 = 30.0;
const WHITE: f64 = 215.0;
const BACKGROUND: f64 = 110.0;
const NOISE: f64 = 2.0;

/// A simulated camera, before which the board is held in ever new poses.
struct SimulatedBoard {
    /// The board in grey values.
    print: Raster<u8>,
    /// The middle of the print and the width of its border in millimetres.
    center_mm: [f64; 2],
    border_mm: f64,
    width_mm: f64,
    size: [usize; 2],
    /// The width of the image at a distance of 1.
    field: f64,
    /// The directions `(x, y, 1)` that the corners of all pixels see. `None` beyond the lens model.
    directions: Raster<Option<[f64; 2]>>,
    random: fastrand::Rng,
    taken: u32,
}

/// The pose of the camera in the board's coordinates. In arrays, since it is needed for every sample.
struct CameraOverBoard {
    /// The place of the camera.
    origin: [f64; 3],
    /// The coordinates of a direction `(x, y, z)` along each of the board's axes, as factors of `x`, `y` and `z`.
    axes: [[f64; 3]; 3],
}

impl CameraOverBoard {
    fn new(to_board: &Isometry3<f64>) -> CameraOverBoard {
        let rotation = to_board.rotation.to_rotation_matrix();
        let axes = [0, 1, 2].map(|axis| [0, 1, 2].map(|k| rotation[(axis, k)]));
        CameraOverBoard { origin: to_board.translation.vector.into(), axes }
    }
}

impl SimulatedBoard {
    /// A camera whose images are `size` pixels large.
    fn new(board: &PrintedBoard, camera: &CameraModel, size: [usize; 2]) -> SimulatedBoard {
        let [columns, rows] = size.map(|side| side + 1);
        let direction = |k: usize| camera.direction([(k % columns) as f64 - 0.5, (k / columns) as f64 - 0.5]);
        let [width_mm, height_mm] = board.size_mm();
        SimulatedBoard {
            print: board.raster(PER_MM),
            center_mm: [width_mm / 2.0, height_mm / 2.0],
            border_mm: board.border_mm(),
            width_mm,
            size,
            field: size[0] as f64 / camera.focal_px[0],
            directions: Raster::new(columns, rows, (0..columns * rows).into_par_iter().map(direction).collect()),
            random: fastrand::Rng::with_seed(1),
            taken: 0,
        }
    }

    /// The pose of the board in the next picture: tilted to all sides, and everywhere in the image.
    fn pose(&self) -> Isometry3<f64> {
        let turn = f64::from(self.taken) * 2.4;
        let tilt = Vector3::new(turn.cos(), turn.sin(), 0.0) * 0.5;
        // Places that fill the image evenly, however many there are.
        let [x, y, z, roll] = [2, 3, 5, 7].map(|base| halton(self.taken + 1, base) - 0.5);
        let roll = Vector3::z() * roll;
        let rotation = UnitQuaternion::new(tilt) * UnitQuaternion::new(roll);
        let distance = self.width_mm / (BOARD_SHARE * self.field) * (1.2 + 0.5 * z);
        let across = self.field * distance * 0.7 * x;
        let [width, height] = self.size.map(|side| side as f64);
        let down = self.field * height / width * distance * 0.7 * y;
        let center = Vector3::new(self.center_mm[0], self.center_mm[1], 0.0);
        Isometry3::from_parts((Vector3::new(across, down, distance) - rotation * center).into(), rotation)
    }

    fn light(&self, CameraOverBoard { origin, axes }: &CameraOverBoard, direction: [f64; 2]) -> f64 {
        let ray = |axis: usize| axes[axis][0] * direction[0] + axes[axis][1] * direction[1] + axes[axis][2];
        let reach = -origin[2] / ray(2);
        let at = |axis: usize| ((origin[axis] + reach * ray(axis) + self.border_mm) * PER_MM).floor();
        let [u, v] = [at(0), at(1)];
        let is_on_board = u >= 0.0 && v >= 0.0 && u < self.print.width() as f64 && v < self.print.height() as f64;
        match reach > 0.0 && is_on_board {
            true => BLACK + (WHITE - BLACK) * f64::from(self.print.get(u as usize, v as usize)) / 255.0,
            false => BACKGROUND,
        }
    }

    fn pixel(&self, camera: &CameraOverBoard, u: usize, v: usize) -> f64 {
        let corner = |du: usize, dv: usize| self.directions.get(u + du, v + dv);
        let (Some(a), Some(b), Some(c), Some(d)) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)) else { return 0.0 };
        let place = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        let sample = |k: usize| {
            let (x, y) = (place(k % SAMPLES), place(k / SAMPLES));
            let between = |axis: usize| (1.0 - y) * (a[axis] + x * (b[axis] - a[axis])) + y * (c[axis] + x * (d[axis] - c[axis]));
            self.light(camera, [between(0), between(1)])
        };
        (0..SAMPLES * SAMPLES).map(sample).sum::<f64>() / (SAMPLES * SAMPLES) as f64
    }
}

/// Element `index` of Halton's sequence in a base, from 0 to 1.
fn halton(mut index: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= f64::from(base);
        value += digit * f64::from(index % base);
        index /= base;
    }
    value
}

impl BlockingCamera for SimulatedBoard {
    type Error = Infallible;

    fn take(&mut self, _: Duration, is_cancelled: &AtomicBool) -> std::result::Result<Picture, Infallible> {
        let camera = CameraOverBoard::new(&self.pose().inverse());
        self.taken += 1;
        let [width, height] = self.size;
        let gray = |k: usize| if is_cancelled.load(Ordering::Relaxed) { 0.0 } else { self.pixel(&camera, k % width, k / width) };
        let grays: Vec<f64> = (0..width * height).into_par_iter().map(gray).collect();
        // The sum of twelve numbers from 0 to 1 has a variance of 1.
        let mut noise = || NOISE * ((0..12).map(|_| self.random.f64()).sum::<f64>() - 6.0);
        let bytes = grays.iter().map(|gray| (gray + noise()).round().clamp(0.0, 255.0) as u8).collect();
        Ok(Picture::Gray(GrayImage::from_raw(width as u32, height as u32, bytes).expect("a byte for each pixel")))
    }
}
