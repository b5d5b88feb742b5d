//! The match of all programs in this folder: frames of 160x120 pixels with two neighbours, printed as a map of the disparities.
#![no_std]

use cortex_m as _; // Provides the critical section.
use multiscopic_core::{BlockMatchingParams, Disparity, Frame, Fusion, ScanlineSource, SearchConfig, Views, params};
use semihosting::{print, println};

const SEARCH: SearchConfig =
    SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
params!(
    /// The parameters, which are checked when this is compiled.
    pub Match: BlockMatchingParams = SEARCH.block_matching(7)
);

/// The memory that the matcher takes.
pub type Memory = [u32; Match::PARAMS.memory_words()];

/// A line of disparities.
pub type Line = [Option<Disparity>; Match::PARAMS.width()];

/// Your camera, flash or file takes its place: here, a box 9 pixels away from its place in the neighbours, before a wall 2 pixels
/// away.
pub struct Camera;

impl ScanlineSource for Camera {
    type Error = core::convert::Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let shift = |d| if let Frame::View(view) = frame { view.shift(d).0 } else { 0 };
        for (pixel, u) in line.iter_mut().zip(0..) {
            let (near, far) = (u - shift(9), u - shift(2));
            let is_box = (50..110).contains(&near) && (30..90).contains(&v);
            // From another part of the texture.
            *pixel = texture(if is_box { near + 1000 } else { far }, v as i32);
        }
        Ok(())
    }
}

fn texture(u: i32, v: i32) -> u8 {
    ((u * u * 31 + v * v * 17 + u * v * 7) >> 3) as u8
}

/// Prints a digit for every fourth pixel of every eighth line: its disparity.
pub fn print_line(v: usize, line: &Line) {
    if v % 8 == 4 {
        line.iter().skip(2).step_by(4).for_each(|disparity| print!("{}", disparity.map_or(0, pixels)));
        println!();
    }
}

/// A disparity in whole pixels.
fn pixels(d: Disparity) -> i16 {
    (d.to_bits() + 32) / 64
}
