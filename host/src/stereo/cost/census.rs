//! Matching costs by the centre-symmetric census transform.
//!
//! A descriptor has one bit for each pair of opposite pixels in a window: which of the two is brighter
//! (Spangenberg, Langner and Rojas, "Weighted semi-global matching and center-symmetric census transform for
//! robust driver assistance", 2013). The cost of a match is the Hamming distance of the descriptors.

use std::ops::Range;

use image::GrayImage;
use multiscopic_core::{Frame, Fusion, Search, View};
use rayon::prelude::*;

use super::cost_rows::CostRows;
use crate::{
    images::Frames,
    stereo::lanes::{LANES, Vector, Vectors},
};

/// The window of the transform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Census {
    /// 5 x 5 pixels, 12 bits.
    Window5x5,
    /// 7 x 7 pixels, 24 bits.
    Window7x7,
    /// 9 x 7 pixels, 31 bits.
    #[default]
    Window9x7,
}

impl Census {
    /// Every window, the smallest first.
    pub const ALL: [Census; 3] = [Census::Window5x5, Census::Window7x7, Census::Window9x7];

    /// The greatest cost of any window.
    pub const MAX_COST: u16 = 31;

    /// The window's size, as command lines name it.
    pub const fn name(self) -> &'static str {
        match self {
            Census::Window5x5 => "5x5",
            Census::Window7x7 => "7x7",
            Census::Window9x7 => "9x7",
        }
    }

    /// The penalties P1 and P2 of semi-global matching that suit this window: a quarter of its bits, and six
    /// times that.
    pub const fn default_penalties(self) -> [u16; 2] {
        let p1 = (self.bits() as u16 + 2) / 4;
        [p1, 6 * p1]
    }

    /// The fused costs of `frames`. Computes the descriptors of all frames on the threads of the current
    /// pool.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn rows<'a>(self, frames: &Frames, search: &'a Search) -> CensusRows<'a> {
        CensusRows::new(frames, search, self)
    }

    /// How far the window reaches: `[to each side, up and down]`, in pixels.
    pub const fn radius(self) -> [usize; 2] {
        match self {
            Census::Window5x5 => [2, 2],
            Census::Window7x7 => [3, 3],
            Census::Window9x7 => [4, 3],
        }
    }

    /// Bits of a descriptor, one for each pair of opposite pixels. This is the greatest cost.
    pub const fn bits(self) -> usize {
        let [rx, ry] = self.radius();
        ((2 * rx + 1) * (2 * ry + 1) - 1) / 2
    }

    /// The offsets of the pixels that are compared with their opposites, in the order of the bits.
    fn offsets(self) -> impl Iterator<Item = [isize; 2]> {
        let [rx, ry] = self.radius().map(|radius| radius as isize);
        let all = (-ry..=0).flat_map(move |dy| (-rx..=rx).map(move |dx| [dx, dy]));
        all.take(self.bits())
    }
}

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

    /// A line of descriptors. The bytes of one lie [`stride`](Descriptors::stride) apart.
    #[inline(always)]
    fn line(&self, y: usize) -> &[u8] {
        &self.data[y * self.bytes * self.stride..][..self.bytes * self.stride]
    }
}

/// The fused costs of a centre and its views, in bits on the scale of the fusion.
#[derive(Debug)]
pub struct CensusRows<'a> {
    search: &'a Search,
    census: Census,
    center: Descriptors,
    views: Vec<(View, Descriptors)>,
}

impl CostRows for CensusRows<'_> {
    type Cost = u16;

    fn search(&self) -> &Search {
        self.search
    }

    fn max_cost(&self) -> u16 {
        self.census.bits() as u16 * self.search.fusion().scale() as u16
    }

    #[inline(always)]
    fn row<I: Vectors>(&self, isa: I, v: usize, stride: usize, row: &mut [u16]) {
        // By descriptor size and number of views, so that the inner loops unroll.
        match (self.center.bytes, &self.views[..]) {
            (2, views) => self.fuse_row::<I, 2, 4>(isa, views, v, stride, row),
            (3, views) => self.fuse_row::<I, 3, 4>(isa, views, v, stride, row),
            (_, [view]) => self.fuse_row::<I, 4, 1>(isa, std::slice::from_ref(view), v, stride, row),
            (_, views @ [_, _]) => self.fuse_row::<I, 4, 2>(isa, views, v, stride, row),
            (_, views) => self.fuse_row::<I, 4, 4>(isa, views, v, stride, row),
        }
    }
}

impl<'a> CensusRows<'a> {
    fn new(frames: &Frames, search: &'a Search, census: Census) -> CensusRows<'a> {
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        let least = isize::from(search.min_disparity());
        // The candidates of the first and the last pixel of a line reach into the padding.
        let padding = [(-least).max(0) as usize, least.max(0) as usize + search.num_disparities().next_multiple_of(LANES)];
        let descriptors = |view| Descriptors::new(image(Frame::View(view)), census, Orientation::of(view), padding);
        CensusRows {
            search,
            census,
            center: Descriptors::new(image(Frame::Center), census, Orientation::Upright, [0, 0]),
            views: search.views().iter().map(|view| (view, descriptors(view))).collect(),
        }
    }

    /// The fused costs of row `v`, of descriptors of `BYTES` bytes and at most `V` views.
    #[inline(always)]
    fn fuse_row<I: Vectors, const BYTES: usize, const V: usize>(
        &self,
        isa: I,
        views: &[(View, Descriptors)],
        v: usize,
        stride: usize,
        row: &mut [u16],
    ) {
        let (center, count) = (self.center.line(v), self.search.num_disparities());
        let none = isa.splat(u16::MAX);
        for (u, fused) in row.chunks_exact_mut(stride).enumerate() {
            let mut descriptor = [0; BYTES];
            for (byte, plane) in descriptor.iter_mut().enumerate() {
                *plane = center[byte * self.center.stride + u];
            }
            let mut candidates: [Option<Candidates<BYTES>>; V] = [const { None }; V];
            for (candidates, (view, descriptors)) in candidates.iter_mut().zip(views) {
                *candidates = Some(Candidates::new(self.search, *view, descriptors, [u, v]));
            }
            for (block, fused) in fused.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let mut costs = [none; V];
                for (costs, candidates) in costs.iter_mut().zip(candidates.iter().flatten()) {
                    *costs = candidates.costs(isa, descriptor, block, count);
                }
                fuse(isa, self.search.fusion(), costs).store(fused);
            }
        }
    }
}

/// The candidates of a pixel in a view.
struct Candidates<'a, const BYTES: usize> {
    /// The bytes of their descriptors, one plane each, from the smallest disparity on.
    bytes: [&'a [u8]; BYTES],
    /// The indices of the disparities at which the view sees the pixel.
    available: Range<u16>,
}

impl<'a, const BYTES: usize> Candidates<'a, BYTES> {
    #[inline(always)]
    fn new(search: &Search, view: View, descriptors: &'a Descriptors, [u, v]: [usize; 2]) -> Candidates<'a, BYTES> {
        let (coordinate, line) = if view.is_horizontal() { (u, v) } else { (v, u) };
        let position = if view.sign() > 0 { coordinate } else { descriptors.length - 1 - coordinate };
        let start = (position + descriptors.front).wrapping_add_signed(search.min_disparity().into());
        let line = descriptors.line(line);
        let mut bytes = [line; BYTES];
        for (byte, bytes) in bytes.iter_mut().enumerate() {
            *bytes = &line[byte * descriptors.stride + start..];
        }
        let available = view.available(coordinate, descriptors.length, search.min_disparity(), search.num_disparities());
        Candidates { bytes, available }
    }

    /// The costs of a block of [`LANES`] disparities, out of `count` in all.
    #[inline(always)]
    fn costs<I: Vectors>(&self, isa: I, center: [u8; BYTES], block: usize, count: usize) -> I::Vector {
        let first = block * LANES;
        let mut bytes = [&[0; LANES]; BYTES];
        for (block, bytes) in bytes.iter_mut().zip(self.bytes) {
            *block = bytes[first..].first_chunk().expect("lines are padded to whole blocks");
        }
        let costs = isa.hamming_distances(center, bytes);
        let Range { start, end } = self.available;
        if start == 0 && usize::from(end) == count && first + LANES <= count {
            return costs;
        }
        let (none, indices) = (isa.splat(u16::MAX), isa.load(&INDICES));
        let (start, end) = (isa.splat(start.saturating_sub(first as u16)), isa.splat(end.saturating_sub(first as u16)));
        start.if_greater(indices, none, end.if_greater(indices, costs, none))
    }
}

/// The index of each lane.
static INDICES: [u16; LANES] = {
    let mut indices = [0; LANES];
    let mut i = 0;
    while i < LANES {
        indices[i] = i as u16;
        i += 1;
    }
    indices
};

/// The rules of [`Fusion::fuse`] in lanes, on the scale of the rule. A cost that does not exist is
/// `u16::MAX`, which no other cost reaches.
#[inline(always)]
fn fuse<I: Vectors, const V: usize>(isa: I, fusion: Fusion, mut costs: [I::Vector; V]) -> I::Vector {
    let twice = |cost: I::Vector| cost.saturating_add(cost);
    let thrice = |cost: I::Vector| cost.saturating_add(cost).saturating_add(cost);
    let none = isa.splat(u16::MAX);
    match fusion {
        Fusion::Min => costs.into_iter().fold(none, |least, cost| least.min(cost)),
        Fusion::Mean => {
            let (zero, one) = (isa.splat(0), isa.splat(1));
            let (mut sum, mut count) = (zero, zero);
            for cost in costs {
                sum = sum.saturating_add(none.if_greater(cost, cost, zero));
                count = count.saturating_add(none.if_greater(cost, one, zero));
            }
            let mean = count.if_greater(zero, twice(twice(thrice(sum))), none);
            let mean = count.if_greater(one, twice(thrice(sum)), mean);
            let mean = count.if_greater(isa.splat(2), twice(twice(sum)), mean);
            count.if_greater(isa.splat(3), thrice(sum), mean)
        }
        Fusion::Heuristic => {
            // An exchange sort.
            for i in 0..V {
                for j in i + 1..V {
                    (costs[i], costs[j]) = (costs[i].min(costs[j]), costs[i].max(costs[j]));
                }
            }
            let at = |i: usize| if i < V { costs[i % V] } else { none };
            let (c1, c2, c3) = (at(0), at(1), at(2));
            // A third cost that does not exist is above three times any second one, so the rule of two
            // applies.
            let several =
                c3.if_greater(thrice(c2), thrice(c1.saturating_add(c2)), twice(c1.saturating_add(c2).saturating_add(c3)));
            none.if_greater(c2, several, twice(thrice(c1)))
        }
    }
}
