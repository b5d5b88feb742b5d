//! The census transform of an image, line by line, and the pixels that it compares.

use multiscopic_core::{
    Census,
    kernel::{Kernel, Work},
};
use rayon::prelude::*;

use crate::simd::{Simd, Task};

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
    /// The offsets of the two pixels that each bit compares.
    pairs: Vec<[[isize; 2]; 2]>,
    /// True if the last column comes first.
    pub is_mirrored: bool,
    pub shape: LineShape,
}

/// The samples of an image, or of the blurred one.
#[derive(Debug)]
enum Samples {
    Gray(ExtendedImage<u8>),
    Blurred(ExtendedImage<u16>),
}

impl CensusImage {
    /// An image, from right to left if it `is_mirrored`, with `[front, back]` pixels of padding around the descriptors of a line.
    pub fn new(
        image: &[u8],
        size: [usize; 2],
        census: Census,
        sampling: CensusSampling,
        is_mirrored: bool,
        [front, back]: [usize; 2],
    ) -> CensusImage {
        let turn = |[dx, dy]: [isize; 2]| [if is_mirrored { -dx } else { dx }, dy];
        let pairs: Vec<_> = sampling.pairs(census).into_iter().map(|pair| pair.map(turn)).collect();
        let reach = pairs.iter().flatten().flatten().map(|distance| distance.unsigned_abs()).max().unwrap_or_default();
        let samples = match sampling {
            CensusSampling::CentralBlurred => {
                Samples::Blurred(ExtendedImage::new(&blurred(image, size), size, is_mirrored, reach))
            }
            _ => Samples::Gray(ExtendedImage::new(image, size, is_mirrored, reach)),
        };
        let [length, _] = size;
        let shape = LineShape { length, front, stride: front + length + back, bytes: census.bytes() };
        CensusImage { samples, pairs, is_mirrored, shape }
    }

    /// The column of the image at an index of a line, and the other way round.
    pub fn column(&self, index: usize) -> usize {
        if self.is_mirrored { self.shape.length - 1 - index } else { index }
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
    fn compare<S: PartialOrd>(&self, samples: &ExtendedImage<S>, y: usize, planes: &mut [u8]) {
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

/// An image that is extended beyond its borders by replication.
#[derive(Debug)]
struct ExtendedImage<S> {
    /// Pixels in a line, without its extension.
    length: usize,
    /// Lines, without their extension.
    count: usize,
    /// Pixels of the extension on each side.
    reach: usize,
    samples: Vec<S>,
}

impl<S: Copy + Default + Send + Sync> ExtendedImage<S> {
    fn new(image: &[S], [length, count]: [usize; 2], is_mirrored: bool, reach: usize) -> ExtendedImage<S> {
        let padded = length + 2 * reach;
        let mut samples = vec![S::default(); padded * (count + 2 * reach)];
        samples.par_chunks_exact_mut(padded).enumerate().for_each(|(y, padded)| {
            let y = y.saturating_sub(reach).min(count - 1);
            let line = &mut padded[reach..][..length];
            line.copy_from_slice(&image[y * length..][..length]);
            if is_mirrored {
                line.reverse();
            }
            let (first, last) = (line[0], line[length - 1]);
            padded[..reach].fill(first);
            padded[reach + length..].fill(last);
        });
        ExtendedImage { length, count, reach, samples }
    }
}

impl<S> ExtendedImage<S> {
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

/// The pixels that a census compares, and the image they are taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CensusSampling {
    /// Opposite pixels of the window, as the core does.
    Opposite,
    /// The same the other way round: a bit is set where the core's pair is the brighter one first.
    Reversed,
    /// Every other pixel of the window, as in a quincunx, with the one in the middle.
    Central,
    /// The same in the [blurred] image, with a window of three times the size.
    CentralBlurred,
}

impl CensusSampling {
    /// The offsets `[dx, dy]` of the two pixels that each bit compares: it is set if the first is darker.
    pub fn pairs(self, census: Census) -> Vec<[[isize; 2]; 2]> {
        let spacing = match self {
            CensusSampling::Opposite => return census.offsets().map(|[dx, dy]| [[dx, dy], [-dx, -dy]]).collect(),
            CensusSampling::Reversed => return census.offsets().map(|[dx, dy]| [[-dx, -dy], [dx, dy]]).collect(),
            CensusSampling::Central => 1,
            CensusSampling::CentralBlurred => 3,
        };
        let [rx, ry] = census.radius().map(|radius| radius as isize);
        let all = (-ry..=ry).flat_map(|dy| (-rx..=rx).map(move |dx| [dx, dy]));
        // About as many as half of the window has.
        all.filter(|[dx, dy]| (dx + dy) % 2 != 0).map(|offset| [offset.map(|distance| spacing * distance), [0, 0]]).collect()
    }
}

/// A Gaussian with a standard deviation of 1.5 pixels, in 256ths: the weights of a pixel and of those 1 to 4 pixels
/// to either side.
const WEIGHTS: [u32; 5] = [68, 55, 28, 9, 2];
const _: () = assert!(WEIGHTS[0] + 2 * (WEIGHTS[1] + WEIGHTS[2] + WEIGHTS[3] + WEIGHTS[4]) == 256);

/// The fractional bits of blurred samples, which fill 16 bits. They order pixels of areas that are nearly flat.
const FRACTION_BITS: u32 = 8;

/// The image blurred by the [Gaussian](WEIGHTS), in 256ths of a grey level, rounded half up. It is replicated beyond its borders.
/// Computed on the threads of the current pool.
fn blurred(image: &[u8], [width, height]: [usize; 2]) -> Vec<u16> {
    let reach = WEIGHTS.len() - 1;
    // Sums of a row are at most 256 times a sample, so that they fit 16 bits.
    let mut sums = vec![0_u16; width * height];
    sums.par_chunks_exact_mut(width).zip(image.par_chunks_exact(width)).for_each(|(sums, row)| {
        let before = std::iter::repeat_n(row[0], reach);
        let extended: Vec<u8> = before.chain(row.iter().copied()).chain(std::iter::repeat_n(row[width - 1], reach)).collect();
        let sample = |u: usize| u32::from(extended[u]);
        for (u, sum) in sums.iter_mut().enumerate() {
            let pairs = (1..=reach).map(|k| WEIGHTS[k] * (sample(u + reach - k) + sample(u + reach + k)));
            *sum = (WEIGHTS[0] * sample(u + reach) + pairs.sum::<u32>()) as u16;
        }
    });
    let mut samples = vec![0_u16; width * height];
    samples.par_chunks_exact_mut(width).enumerate().for_each(|(v, samples)| {
        let row = |v: usize| &sums[v * width..][..width];
        let mut totals: Vec<u32> = row(v).iter().map(|&sum| WEIGHTS[0] * u32::from(sum)).collect();
        for (k, weight) in WEIGHTS.into_iter().enumerate().skip(1) {
            let (above, below) = (row(v.saturating_sub(k)), row((v + k).min(height - 1)));
            for ((total, &above), &below) in totals.iter_mut().zip(above).zip(below) {
                *total += weight * (u32::from(above) + u32::from(below));
            }
        }
        let shift = 16 - FRACTION_BITS;
        samples.iter_mut().zip(totals).for_each(|(sample, total)| *sample = ((total + (1 << (shift - 1))) >> shift) as u16);
    });
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_a_gaussian() {
        let place = |i: usize| (i % 21, i / 21);
        let point: Vec<u8> = (0..21 * 19).map(|i| if place(i) == (10, 9) { 255 } else { 0 }).collect();
        for (i, sample) in blurred(&point, [21, 19]).into_iter().enumerate() {
            let (u, v) = place(i);
            let weight = |at: usize, center: usize| WEIGHTS.get(at.abs_diff(center)).copied().unwrap_or_default();
            let exact = f64::from(255 * weight(u, 10) * weight(v, 9)) / 65536.0;
            assert_eq!(f64::from(sample), (256.0 * exact + 0.5).floor(), "({u}, {v})");
        }
        // The weights are those of the Gaussian, to the nearest but one 256th.
        let total: f64 = (-9..=9).map(|k| (-f64::from(k * k) / 4.5).exp()).sum();
        for (k, weight) in (0..).zip(WEIGHTS) {
            assert!((f64::from(weight) - 256.0 * (-f64::from(k * k) / 4.5).exp() / total).abs() < 0.75, "{k}");
        }
    }

    #[test]
    fn every_sampling_has_about_as_many_bits_which_fit_a_word() {
        let bits = |sampling: CensusSampling| Census::ALL.map(|census| sampling.pairs(census).len());
        assert_eq!([CensusSampling::Opposite, CensusSampling::Reversed].map(bits), [Census::ALL.map(Census::bits); 2]);
        // A window of 9x7 has 32 pixels of the colour that its middle does not have on a chessboard.
        let chessboard = Census::ALL.map(|census| if census.bits() == 31 { 32 } else { census.bits() });
        assert_eq!([CensusSampling::Central, CensusSampling::CentralBlurred].map(bits), [chessboard; 2]);
    }

    #[test]
    fn borders_are_replicated() {
        assert_eq!(blurred(&[201; 2], [2, 1]), [256 * 201; 2]);
    }
}
