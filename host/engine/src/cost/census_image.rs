//! The census transform of an image, line by line.

use multiscopic_core::{
    Census, View,
    kernel::{Kernel, Work},
};
use rayon::prelude::*;

use super::census_sampling::{CensusSampling, blurred};
use crate::simd::{Simd, Task};

/// The orientation of an image in which matches of ascending disparity are contiguous in its lines.
#[derive(Clone, Copy, Debug)]
pub(super) enum Orientation {
    Upright,
    /// The last column comes first.
    Mirrored,
    /// Columns become lines.
    Transposed,
    /// Columns become lines, and the last row comes first.
    TransposedMirrored,
}

impl Orientation {
    /// The orientation for a view. None makes the matches of those outside the cross contiguous: they stay upright.
    pub fn of(view: View) -> Orientation {
        match view {
            View::RIGHT => Orientation::Mirrored,
            View::TOP => Orientation::Transposed,
            View::BOTTOM => Orientation::TransposedMirrored,
            _ => Orientation::Upright,
        }
    }

    fn is_transposed(self) -> bool {
        matches!(self, Orientation::Transposed | Orientation::TransposedMirrored)
    }

    pub fn is_mirrored(self) -> bool {
        matches!(self, Orientation::Mirrored | Orientation::TransposedMirrored)
    }

    /// An offset in the turned image.
    fn turn(self, [dx, dy]: [isize; 2]) -> [isize; 2] {
        let [dx, dy] = if self.is_transposed() { [dy, dx] } else { [dx, dy] };
        [if self.is_mirrored() { -dx } else { dx }, dy]
    }
}

/// The memory layout of the descriptors of a line. Their bytes are planar: all first bytes, then all second bytes, and so on.
#[derive(Clone, Copy, Debug)]
pub(super) struct LineShape {
    /// Pixels in a line.
    pub length: usize,
    /// Pixels of zero padding before them.
    pub front: usize,
    /// Pixels in a line with its padding.
    pub stride: usize,
    /// Bytes of a descriptor.
    pub bytes: usize,
}

/// An image whose lines are transformed when they are needed.
#[derive(Debug)]
pub(super) struct CensusImage {
    samples: Samples,
    /// The offsets of the two pixels that each bit compares, in the turned image.
    pairs: Vec<[[isize; 2]; 2]>,
    pub shape: LineShape,
}

/// The samples of an image, or of the blurred one.
#[derive(Debug)]
enum Samples {
    Gray(TurnedImage<u8>),
    Blurred(TurnedImage<u16>),
}

impl CensusImage {
    /// An image turned to an `orientation`, with `[front, back]` pixels of padding around the descriptors of a line.
    pub fn new(
        image: &[u8],
        size: [usize; 2],
        census: Census,
        sampling: CensusSampling,
        orientation: Orientation,
        [front, back]: [usize; 2],
    ) -> CensusImage {
        let pairs: Vec<_> = sampling.pairs(census).into_iter().map(|pair| pair.map(|offset| orientation.turn(offset))).collect();
        let reach = pairs.iter().flatten().flatten().map(|distance| distance.unsigned_abs()).max().unwrap_or_default();
        let samples = match sampling {
            CensusSampling::CentralBlurred => Samples::Blurred(TurnedImage::new(&blurred(image, size), size, orientation, reach)),
            _ => Samples::Gray(TurnedImage::new(image, size, orientation, reach)),
        };
        let length = size[usize::from(orientation.is_transposed())];
        let shape = LineShape { length, front, stride: front + length + back, bytes: census.bytes() };
        CensusImage { samples, pairs, shape }
    }

    /// The descriptors of line `y`.
    #[inline(always)]
    pub fn line(&self, y: usize) -> Vec<u8> {
        let mut planes = vec![0; self.shape.bytes * self.shape.stride];
        self.transform(y, &mut planes);
        planes
    }

    /// Computes the descriptors of line `y` into planes of zeros.
    #[inline(always)]
    fn transform(&self, y: usize, planes: &mut [u8]) {
        match &self.samples {
            Samples::Gray(samples) => self.compare(samples, y, planes),
            Samples::Blurred(samples) => self.compare(samples, y, planes),
        }
    }

    #[inline(always)]
    fn compare<S: PartialOrd>(&self, samples: &TurnedImage<S>, y: usize, planes: &mut [u8]) {
        let LineShape { length, front, stride, .. } = self.shape;
        for (bit, pair) in self.pairs.iter().enumerate() {
            let [ones, others] = pair.map(|offset| samples.line_at(y, offset));
            let plane = &mut planes[bit / 8 * stride + front..][..length];
            let bit = 1 << (bit % 8);
            for ((byte, a), b) in plane.iter_mut().zip(ones).zip(others) {
                *byte |= if a < b { bit } else { 0 };
            }
        }
    }

    /// The descriptors of all lines, on the threads of the current pool.
    pub fn all_lines(&self, simd: Simd) -> Vec<u8> {
        let line = self.shape.bytes * self.shape.stride;
        let count = match &self.samples {
            Samples::Gray(samples) => samples.count,
            Samples::Blurred(samples) => samples.count,
        };
        let mut data = vec![0; count * line];
        data.par_chunks_exact_mut(line).enumerate().for_each(|(y, planes)| simd.run(Transform { image: self, y, planes }));
        data
    }
}

/// An image turned to an orientation, and extended beyond its borders by replication.
#[derive(Debug)]
struct TurnedImage<S> {
    /// Pixels in a line, without its extension.
    length: usize,
    /// Lines, without their extension.
    count: usize,
    /// Pixels of the extension on each side.
    reach: usize,
    samples: Vec<S>,
}

impl<S: Copy + Default + Send + Sync> TurnedImage<S> {
    fn new(image: &[S], [width, height]: [usize; 2], orientation: Orientation, reach: usize) -> TurnedImage<S> {
        let [length, count] = if orientation.is_transposed() { [height, width] } else { [width, height] };
        let padded = length + 2 * reach;
        let mut samples = vec![S::default(); padded * (count + 2 * reach)];
        samples.par_chunks_exact_mut(padded).enumerate().for_each(|(y, padded)| {
            let y = y.saturating_sub(reach).min(count - 1);
            let line = &mut padded[reach..][..length];
            if orientation.is_transposed() {
                let column = image[y..].iter().step_by(width);
                line.iter_mut().zip(column).for_each(|(sample, &from)| *sample = from);
            } else {
                line.copy_from_slice(&image[y * width..][..width]);
            }
            if orientation.is_mirrored() {
                line.reverse();
            }
            let (first, last) = (line[0], line[length - 1]);
            padded[..reach].fill(first);
            padded[reach + length..].fill(last);
        });
        TurnedImage { length, count, reach, samples }
    }
}

impl<S> TurnedImage<S> {
    /// A line of the image as seen from an `[x, y]` offset.
    #[inline(always)]
    fn line_at(&self, y: usize, [dx, dy]: [isize; 2]) -> &[S] {
        let (x, y) = (self.reach.wrapping_add_signed(dx), (y + self.reach).wrapping_add_signed(dy));
        &self.samples[y * (self.length + 2 * self.reach) + x..][..self.length]
    }
}

/// Computes the descriptors of a line, compiled for the vector instructions.
struct Transform<'a> {
    image: &'a CensusImage,
    y: usize,
    planes: &'a mut [u8],
}

impl Task for Transform<'_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(self);
    }
}

impl Work for Transform<'_> {
    #[inline(always)]
    fn run(self) {
        self.image.transform(self.y, self.planes);
    }
}
