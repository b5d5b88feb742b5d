//! Pixels of the image, and what labels them.

/// The label of a pixel: a disparity in pixels, or [`OCCLUDED`].
pub type Label = i16;

/// The label of a pixel that is not matched.
pub const OCCLUDED: Label = Label::MIN;

/// A pixel of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// Its column.
    pub u: usize,
    /// Its row.
    pub v: usize,
    /// Its index among all pixels, row by row.
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
pub struct Pair {
    /// The left or upper one.
    pub first: Pixel,
    /// The right or lower one.
    pub second: Pixel,
    /// Whether the second lies below the first, not to its right.
    pub down: bool,
}
