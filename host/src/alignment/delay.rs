//! The delay between a camera that runs free and the stage that slides it there and back: the delay at which frames of both ways
//! agree on where they were taken.
//!
//! ```text
//! for some frames of the way there, while the speed is constant:
//!     the frame of the way back that is most like it
//!     farther ones on both sides of it, until most corners have moved enough between them
//!     for each corner of the frame, found in these two: the share of the way between them at which it would be in place
//!     delay of the corner = that at which the tracks of both ways put the frame there
//! delay = the least squares of all corners over a line in their rows, without those that are off: its slope is the rolling shutter's
//! ```

use image::GrayImage;
use multiscopic_core::View;
use rayon::prelude::*;

use super::tracking::{Pyramid, RADIUS, corners, find};
use crate::{capture::Track, statistics::median};

/// The frames of the way there that are compared.
const COMPARED: usize = 12;
/// The corners of each.
const CORNERS: usize = 200;
/// The pixels by which corners are searched along the rows.
const REACH: i16 = 24;
/// The least motion of a corner between the two frames around it, in pixels, and that which most corners should have.
const MIN_MOTION: (f64, f64) = (1.0, 5.0);
/// The most frames that these two are away from the middle.
const FARTHEST: usize = 8;
/// The longest delay, in seconds, in either direction.
const LONGEST_S: f64 = 1.0;
/// The least number of frames that must tell the delay, and of corners in each.
const LEAST: (usize, usize) = (3, 12);
/// The deviation of the delay below which no estimate is: errors that corners share, in pixels, and what times are not measured
/// to, in seconds.
const FLOOR: (f64, f64) = (0.005, 1e-4);

/// A way along the line.
#[derive(Clone, Copy, Debug)]
pub struct Way<'a> {
    /// The places of the stage.
    pub track: &'a Track,
    /// The frames, with the times at which they arrived, in seconds.
    pub frames: &'a [(f64, GrayImage)],
}

/// The delay of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    /// The time from the middle of the exposure of a frame's middle row to its arrival, beyond that with which the stage tells
    /// its place, in seconds.
    pub seconds: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// The time between the exposures of two rows, in seconds.
    pub row_seconds: f64,
    /// Its standard deviation.
    pub row_deviation: f64,
}

/// A corner that tells a delay.
#[derive(Clone, Copy)]
struct Told {
    /// The frame of the way there.
    frame: usize,
    /// The row, from the middle one on.
    row: f64,
    delay: f64,
    weight: f64,
    /// The time in which it moves by a pixel against the frames of the way back, in seconds.
    seconds_per_pixel: f64,
}

impl Delay {
    /// Estimates the delay from frames that were taken on the way there and back. `None` if too few of them show enough texture to
    /// tell it.
    pub fn estimate(there: Way<'_>, back: Way<'_>) -> Option<Delay> {
        let cruise = there.track.cruise()?;
        let is_within = |time: f64| (cruise[0]..=cruise[1]).contains(&time);
        let steady: Vec<usize> = (0..there.frames.len()).filter(|&n| is_within(there.frames[n].0)).collect();
        let count = COMPARED.min(steady.len());
        let chosen: Vec<usize> = (0..count).map(|n| steady[(2 * n + 1) * steady.len() / (2 * count)]).collect();
        let smaller: Vec<Vec<u8>> = back.frames.iter().map(|(_, image)| sampled(image)).collect();
        let told = chosen.par_iter().flat_map_iter(|&n| told(n, there, back, &smaller));
        let told: Vec<Told> = told.collect();
        fit(told)
    }
}

/// Every fourth pixel of every fourth row.
fn sampled(image: &GrayImage) -> Vec<u8> {
    let rows = image.rows().step_by(4);
    rows.flat_map(|row| row.step_by(4).map(|pixel| pixel.0[0])).collect()
}

/// The delays that the corners of a frame tell.
fn told(n: usize, there: Way<'_>, back: Way<'_>, smaller: &[Vec<u8>]) -> Vec<Told> {
    let (time, image) = &there.frames[n];
    let own = sampled(image);
    let difference = |other: &Vec<u8>| own.iter().zip(other).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
    let Some(nearest) = (0..smaller.len()).min_by_key(|&k| difference(&smaller[k])) else { return Vec::new() };
    let (places, range) = (corners(image, CORNERS, RADIUS + 1), -REACH..=REACH);
    let pyramid = Pyramid::new(image);
    let mut around = None;
    let mut away = 1;
    while away <= FARTHEST && away <= nearest && nearest + away < smaller.len() {
        let outer = [nearest - away, nearest + away].map(|k| &back.frames[k]);
        let found =
            outer.map(|(_, other)| find([(image, &pyramid), (other, &Pyramid::new(other))], &places, View::RIGHT, &range));
        let motions = places.iter().zip(found[0].iter().zip(&found[1])).filter_map(|(corner, (a, b))| {
            let [a, b] = [(*a)?, (*b)?].map(|found| found.at[0] - corner[0] as f64);
            let motion = a - b;
            (motion.abs() >= MIN_MOTION.0).then(|| (corner[1] as f64, a / motion, motion))
        });
        let motions: Vec<(f64, f64, f64)> = motions.collect();
        let has_moved = median(motions.iter().map(|(_, _, motion)| motion.abs()).collect()) >= MIN_MOTION.1;
        if motions.len() >= LEAST.1 {
            around = Some((outer, motions));
        }
        if has_moved {
            break;
        }
        away *= 2;
    }
    let Some((outer, motions)) = around else { return Vec::new() };
    let middle = (f64::from(image.height()) - 1.0) / 2.0;
    // The frame of the other way comes towards it.
    let between = (outer[1].0 - outer[0].0) / 2.0;
    let delay = |(row, share, motion): (f64, f64, f64)| {
        // Positive where the delay is too small.
        let ahead = |delay: f64| {
            let [a, b] = [outer[0].0, outer[1].0].map(|time| back.track.at(time - delay));
            there.track.at(time - delay) - (a + share * (b - a))
        };
        let (mut least, mut most) = (-LONGEST_S, LONGEST_S);
        if !(ahead(least) > 0.0 && ahead(most) < 0.0) {
            return None;
        }
        while most - least > 1e-5 {
            let half = (least + most) / 2.0;
            *(if ahead(half) > 0.0 { &mut least } else { &mut most }) = half;
        }
        // Beyond the track nobody knows the place.
        let is_known = there.track.knows(time - least) && outer.iter().all(|(time, _)| back.track.knows(time - least));
        let seconds_per_pixel = between / motion.abs();
        is_known.then_some(Told { frame: n, row: row - middle, delay: least, weight: motion * motion, seconds_per_pixel })
    };
    motions.into_iter().filter_map(delay).collect()
}

/// The line through the delays over the rows.
fn fit(mut told: Vec<Told>) -> Option<Delay> {
    let mut line = [median(told.iter().map(|told| told.delay).collect()), 0.0];
    let off = |told: &Told, [delay, slope]: [f64; 2]| told.delay - delay - slope * told.row;
    // The first round drops mismatches alone, before the slope is known.
    for limit in [6.0, 4.0, 3.0] {
        let spread = 1.4826 * median(told.iter().map(|told| off(told, line).abs()).collect());
        told.retain(|told| off(told, line).abs() <= limit * spread.max(FLOOR.1));
        let sum = |of: &dyn Fn(&Told) -> f64| told.iter().map(|told| told.weight * of(told)).sum::<f64>();
        let (weights, rows, delays) = (sum(&|_| 1.0), sum(&|told| told.row), sum(&|told| told.delay));
        let (squares, products) = (sum(&|told| told.row * told.row), sum(&|told| told.row * told.delay));
        let slope = (weights * products - rows * delays) / (weights * squares - rows * rows);
        line = [(delays - slope * rows) / weights, slope];
    }
    // Errors of a frame's time are common to its corners, so frames are what is counted.
    let mut frames: Vec<usize> = told.iter().map(|told| told.frame).collect();
    frames.dedup();
    let of_frame = |frame: usize, of: &dyn Fn(&Told) -> f64| {
        let own = || told.iter().filter(|told| told.frame == frame);
        own().map(|told| told.weight * of(told)).sum::<f64>() / own().map(|told| told.weight).sum::<f64>()
    };
    let of_frames = |of: &dyn Fn(&Told) -> f64| {
        let means: Vec<f64> = frames.iter().map(|&frame| of_frame(frame, of)).collect();
        let count = means.len() as f64;
        (means.iter().map(|mean| mean * mean).sum::<f64>() / (count - 1.0) / count).sqrt()
    };
    if frames.len() < LEAST.0 || told.len() < LEAST.0 * LEAST.1 {
        return None;
    }
    let square = told.iter().map(|told| told.row * told.row).sum::<f64>() / told.len() as f64;
    let floor = (FLOOR.0 * median(told.iter().map(|told| told.seconds_per_pixel).collect())).hypot(FLOOR.1);
    let deviation = of_frames(&|told| off(told, line)).hypot(floor);
    // Errors that the corners of the upper rows share are not those of the lower ones.
    let row_deviation = of_frames(&|told| off(told, line) * told.row / square).hypot(2.0 * floor / square.sqrt());
    let [seconds, slope] = line;
    // What a lower row sees later is as if its frame had arrived earlier.
    line.iter().all(|value| value.is_finite()).then_some(Delay { seconds, deviation, row_seconds: -slope, row_deviation })
}
