//! Pixels, pairs of them, and their labels.

/// The label of a pixel: a disparity in pixels, or [`OCCLUDED`].
pub type Label = i16;

/// The label of an occluded pixel.
pub const OCCLUDED: Label = Label::MIN;

/// A pixel of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// The column.
    pub u: usize,
    /// The row.
    pub v: usize,
    /// The index among all pixels, row by row.
    pub index: usize,
}

impl Pixel {
    /// The pixel at `index` of an image that is `width` pixels wide.
    pub fn new(index: usize, width: usize) -> Pixel {
        Pixel { u: index % width, v: index / width, index }
    }

    /// The pixel in column `u` of row `v` of an image that is `width` pixels wide.
    #[inline(always)]
    pub fn at(u: usize, v: usize, width: usize) -> Pixel {
        Pixel { u, v, index: v * width + u }
    }
}

/// Two neighbouring pixels.
#[derive(Clone, Copy, Debug)]
pub struct NeighborPair {
    /// The left or upper pixel.
    pub first: Pixel,
    /// The right or lower pixel.
    pub second: Pixel,
    /// True if the second pixel lies below the first, false if it lies to its right.
    pub is_vertical: bool,
}
