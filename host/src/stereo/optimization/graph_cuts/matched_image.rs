//! An image in the forms that the energy reads.

use image::{GrayImage, Luma, Rgb, RgbImage};

use crate::stereo::cost::birchfield_tomasi::Intervals;

/// The bit of a Potts code that says that a view sees both pixels of a pair at a disparity.
pub const SEEN: u8 = 1;
/// The bit of a Potts code that says that both pixels of a pair look different, in the centre or in a view.
pub const DIFFERENT: u8 = 2;
/// The shift, in bits, of the code of a pixel and its right neighbour.
pub const RIGHT: usize = 0;
/// The shift, in bits, of the code of a pixel and the neighbour below.
pub const BELOW: usize = 4;

/// An image in the forms that the energy reads.
#[derive(Debug)]
pub struct MatchedImage {
    /// The intervals of intensity that data terms compare.
    pub intervals: Intervals,
    /// Grey, or red, green and blue; the other samples are 0.
    samples: Vec<[u8; 4]>,
    /// For each pixel, [`DIFFERENT`] shifted by [`RIGHT`] if its right neighbour looks different, and by
    /// [`BELOW`] if the one below does.
    pub contrasts: Vec<u8>,
}

impl MatchedImage {
    /// An image in colour if there is `color`, otherwise in grey. Pixels that differ by `threshold` look
    /// different.
    pub fn new(gray: &GrayImage, color: Option<&RgbImage>, threshold: u8) -> MatchedImage {
        let (intervals, samples) = match color {
            Some(color) => (Intervals::of_rgb(color), color.pixels().map(|&Rgb([r, g, b])| [r, g, b, 0]).collect()),
            None => (Intervals::of_gray(gray), gray.pixels().map(|&Luma([luma])| [luma, 0, 0, 0]).collect()),
        };
        let mut image = MatchedImage { intervals, samples, contrasts: Vec::new() };
        let (width, pixels) = (gray.width() as usize, image.samples.len());
        let contrast = |i: usize| {
            let right = !(i + 1).is_multiple_of(width) && image.differ(i, i + 1, threshold);
            let below = i + width < pixels && image.differ(i, i + width, threshold);
            DIFFERENT * (u8::from(right) << RIGHT | u8::from(below) << BELOW)
        };
        image.contrasts = (0..pixels).map(contrast).collect();
        image
    }

    /// The bytes for each pixel of an image with this number of channels.
    pub const fn pixel_bytes(channels: usize) -> usize {
        channels * 3 * size_of::<i16>() + size_of::<[u8; 4]>() + size_of::<u8>()
    }

    /// Returns true if two pixels differ in any channel by `threshold` or more.
    #[inline(always)]
    pub fn differ(&self, a: usize, b: usize, threshold: u8) -> bool {
        let (a, b) = (self.samples[a], self.samples[b]);
        let differences: [u8; 4] = std::array::from_fn(|i| a[i].abs_diff(b[i]));
        differences.into_iter().fold(0, u8::max) >= threshold
    }
}
