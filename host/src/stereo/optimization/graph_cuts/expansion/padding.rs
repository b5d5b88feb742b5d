//! The padded layout: per-pixel arrays with a border of one pixel around the image, so that every pixel has
//! four neighbours.
//!
//! A *slot* is an index into such an array.

use crate::stereo::optimization::graph_cuts::pixel::{Label, Pixel};

/// The label of the slots in the border.
pub const OUTSIDE: Label = Label::MAX;

/// The slots in a row.
#[inline(always)]
pub const fn stride(width: usize) -> usize {
    width + 2
}

/// The slot of the pixel in column `u` of row `v`.
#[inline(always)]
pub const fn slot(u: usize, v: usize, width: usize) -> usize {
    (v + 1) * stride(width) + u + 1
}

/// The pixels of an image, each with its slot.
pub fn pixels([width, height]: [usize; 2]) -> impl Iterator<Item = (Pixel, usize)> {
    let pixel = move |u: usize, v: usize| (Pixel::at(u, v, width), slot(u, v, width));
    (0..height).flat_map(move |v| (0..width).map(move |u| pixel(u, v)))
}
