//! A camera without hardware, before which a board is held in ever new poses.

use std::{
    convert::Infallible,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use image::GrayImage;
use multiscopic::{CameraModel, Raster, calibration::PrintedBoard, capture::BlockingCamera};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;

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

/// A simulated camera that sees the board.
pub struct SimulatedBoard {
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

impl SimulatedBoard {
    /// A camera whose images are `size` pixels large.
    pub fn new(board: &PrintedBoard, camera: &CameraModel, size: [usize; 2]) -> SimulatedBoard {
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

    fn light(&self, to_board: &Isometry3<f64>, direction: [f64; 2]) -> f64 {
        let origin = to_board * Point3::origin();
        let ray = to_board.rotation * Vector3::new(direction[0], direction[1], 1.0);
        let reach = -origin.z / ray.z;
        let at = |axis: usize| ((origin[axis] + reach * ray[axis] + self.border_mm) * PER_MM).floor();
        let [u, v] = [at(0), at(1)];
        let is_on_board = u >= 0.0 && v >= 0.0 && u < self.print.width() as f64 && v < self.print.height() as f64;
        match reach > 0.0 && is_on_board {
            true => BLACK + (WHITE - BLACK) * f64::from(self.print.get(u as usize, v as usize)) / 255.0,
            false => BACKGROUND,
        }
    }

    fn pixel(&self, to_board: &Isometry3<f64>, u: usize, v: usize) -> f64 {
        let corner = |du: usize, dv: usize| self.directions.get(u + du, v + dv);
        let (Some(a), Some(b), Some(c), Some(d)) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)) else { return 0.0 };
        let place = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        let sample = |k: usize| {
            let (x, y) = (place(k % SAMPLES), place(k / SAMPLES));
            let between = |axis: usize| (1.0 - y) * (a[axis] + x * (b[axis] - a[axis])) + y * (c[axis] + x * (d[axis] - c[axis]));
            self.light(to_board, [between(0), between(1)])
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

    fn take(&mut self, _: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, Infallible> {
        let to_board = self.pose().inverse();
        self.taken += 1;
        let [width, height] = self.size;
        let gray =
            |k: usize| if is_cancelled.load(Ordering::Relaxed) { 0.0 } else { self.pixel(&to_board, k % width, k / width) };
        let grays: Vec<f64> = (0..width * height).into_par_iter().map(gray).collect();
        // The sum of twelve numbers from 0 to 1 has a variance of 1.
        let mut noise = || NOISE * ((0..12).map(|_| self.random.f64()).sum::<f64>() - 6.0);
        let bytes = grays.iter().map(|gray| (gray + noise()).round().clamp(0.0, 255.0) as u8).collect();
        Ok(GrayImage::from_raw(width as u32, height as u32, bytes).expect("a byte for each pixel"))
    }
}
