//! Matching costs by the census transform, for rows in any order.

use image::GrayImage;
use multiscopic_core::{
    Census, Frame, Search, View,
    kernel::{Candidates, Kernel, as_vectors_mut},
};
use rayon::prelude::*;

use super::cost_rows::CostRows;
use crate::images::Frames;

/// How an image is turned so that matches of ascending disparity are contiguous in its lines.
#[derive(Clone, Copy, Debug)]
enum Orientation {
    Upright,
    /// The last column comes first.
    Mirrored,
    /// Columns become lines.
    Transposed,
    /// Columns become lines, and the last row comes first.
    TransposedMirrored,
}

impl Orientation {
    fn of(view: View) -> Orientation {
        match (view.is_horizontal(), view.sign() > 0) {
            (true, true) => Orientation::Upright,
            (true, false) => Orientation::Mirrored,
            (false, true) => Orientation::Transposed,
            (false, false) => Orientation::TransposedMirrored,
        }
    }

    fn is_transposed(self) -> bool {
        matches!(self, Orientation::Transposed | Orientation::TransposedMirrored)
    }

    fn is_mirrored(self) -> bool {
        matches!(self, Orientation::Mirrored | Orientation::TransposedMirrored)
    }

    /// An offset in the turned image.
    fn turn(self, [dx, dy]: [isize; 2]) -> [isize; 2] {
        let [dx, dy] = if self.is_transposed() { [dy, dx] } else { [dx, dy] };
        [if self.is_mirrored() { -dx } else { dx }, dy]
    }
}

/// The census transform of an image: a descriptor for each pixel, line by line. The bytes of a line are
/// planar: all first bytes, then all second bytes, and so on.
#[derive(Debug)]
struct Descriptors {
    /// Pixels in a line.
    length: usize,
    /// Pixels in a line with its padding.
    stride: usize,
    /// Pixels of padding before a line.
    front: usize,
    /// Bytes of a descriptor.
    bytes: usize,
    data: Vec<u8>,
}

impl Descriptors {
    /// The transform of an image turned to an `orientation`, with `[front, back]` pixels of zero padding
    /// around each line.
    fn new(image: &GrayImage, census: Census, orientation: Orientation, [front, back]: [usize; 2]) -> Descriptors {
        let reach = census.radius().into_iter().max().unwrap_or_default();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let [length, count] = if orientation.is_transposed() { [height, width] } else { [width, height] };
        // The turned image, extended beyond its borders by replication.
        let padded = length + 2 * reach;
        let mut samples = vec![0; padded * (count + 2 * reach)];
        samples.par_chunks_exact_mut(padded).enumerate().for_each(|(y, line)| {
            let y = y.saturating_sub(reach).min(count - 1);
            for (x, sample) in line.iter_mut().enumerate() {
                let x = x.saturating_sub(reach).min(length - 1);
                let x = if orientation.is_mirrored() { length - 1 - x } else { x };
                let [u, v] = if orientation.is_transposed() { [y, x] } else { [x, y] };
                *sample = image.as_raw()[v * width + u];
            }
        });

        let (bytes, stride) = (census.bits().div_ceil(8), front + length + back);
        let mut data = vec![0; count * bytes * stride];
        data.par_chunks_exact_mut(bytes * stride).enumerate().for_each(|(y, line)| {
            for (bit, offset) in census.offsets().enumerate() {
                let [dx, dy] = orientation.turn(offset);
                let samples_at = |sign: isize| {
                    let (x, y) = (reach.wrapping_add_signed(sign * dx), (y + reach).wrapping_add_signed(sign * dy));
                    &samples[y * padded + x..][..length]
                };
                let plane = &mut line[bit / 8 * stride + front..][..length];
                for ((byte, a), b) in plane.iter_mut().zip(samples_at(1)).zip(samples_at(-1)) {
                    *byte |= u8::from(a < b) << (bit % 8);
                }
            }
        });
        Descriptors { length, stride, front, bytes, data }
    }

    /// The candidates of the pixel `(u, v)` of the centre in this view, and up to `stride` in all.
    #[inline(always)]
    fn candidates<const BYTES: usize>(
        &self,
        search: &Search,
        view: View,
        [u, v]: [usize; 2],
        stride: usize,
    ) -> Candidates<'_, BYTES> {
        let (coordinate, line) = if view.is_horizontal() { (u, v) } else { (v, u) };
        let position = if view.sign() > 0 { coordinate } else { self.length - 1 - coordinate };
        let start = (position + self.front).wrapping_add_signed(search.min_disparity().into());
        let line = self.line(line);
        let mut planes = [line; BYTES];
        for (byte, plane) in planes.iter_mut().enumerate() {
            *plane = &line[byte * self.stride + start..][..stride];
        }
        let available = view.available(coordinate, self.length, search.min_disparity(), search.num_disparities());
        Candidates { planes, available }
    }

    /// A line of descriptors. The bytes of one lie [`stride`](Descriptors::stride) apart.
    #[inline(always)]
    fn line(&self, y: usize) -> &[u8] {
        &self.data[y * self.bytes * self.stride..][..self.bytes * self.stride]
    }
}

/// The fused costs of a centre and its views: the Hamming distances of their descriptors, rounded down.
#[derive(Debug)]
pub struct CensusRows<'a> {
    search: &'a Search,
    center: Descriptors,
    views: Vec<(View, Descriptors)>,
}

impl CostRows for CensusRows<'_> {
    type Cost = u8;

    fn search(&self) -> &Search {
        self.search
    }

    #[inline(always)]
    fn row<I: Kernel>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        // By descriptor size and number of views, so that the inner loops unroll.
        match (self.center.bytes, &self.views[..]) {
            (2, _) => self.fuse_row::<I, 2, 4>(isa, v, stride, row),
            (3, _) => self.fuse_row::<I, 3, 4>(isa, v, stride, row),
            (_, [_]) => self.fuse_row::<I, 4, 1>(isa, v, stride, row),
            (_, [_, _]) => self.fuse_row::<I, 4, 2>(isa, v, stride, row),
            _ => self.fuse_row::<I, 4, 4>(isa, v, stride, row),
        }
    }
}

impl<'a> CensusRows<'a> {
    /// Computes the descriptors of all frames, on the threads of the current pool.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(frames: &Frames, search: &'a Search, census: Census) -> CensusRows<'a> {
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        let least = isize::from(search.min_disparity());
        // The candidates of the first and the last pixel of a line reach into the padding.
        let padding = [(-least).max(0) as usize, least.max(0) as usize + search.num_disparities().next_multiple_of(MOST_LANES)];
        let descriptors = |view| Descriptors::new(image(Frame::View(view)), census, Orientation::of(view), padding);
        CensusRows {
            search,
            center: Descriptors::new(image(Frame::Center), census, Orientation::Upright, [0, 0]),
            views: search.views().iter().map(|view| (view, descriptors(view))).collect(),
        }
    }

    /// The fused costs of row `v`, of descriptors of `BYTES` bytes and at most `V` views.
    #[inline(always)]
    fn fuse_row<I: Kernel, const BYTES: usize, const V: usize>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        let (center, count) = (self.center.line(v), self.search.num_disparities());
        for (u, fused) in row.chunks_exact_mut(stride).enumerate() {
            let mut descriptor = [0; BYTES];
            for (byte, plane) in descriptor.iter_mut().enumerate() {
                *plane = center[byte * self.center.stride + u];
            }
            let mut candidates = [const { None }; V];
            for (candidates, (view, descriptors)) in candidates.iter_mut().zip(&self.views) {
                *candidates = Some(descriptors.candidates(self.search, *view, [u, v], stride));
            }
            isa.hamming_costs(self.search.fusion(), descriptor, &candidates, count, as_vectors_mut::<I>(fused));
        }
    }
}

/// The lanes of the widest vectors.
const MOST_LANES: usize = 64;
