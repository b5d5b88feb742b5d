//! Matching costs by the centre-symmetric census transform.
//!
//! A pixel is described by one bit for each pair of pixels opposite to each other in a window around it: which of them is brighter
//! (Spangenberg, Langner and Rojas, "Weighted semi-global matching and center-symmetric census transform for robust driver
//! assistance", 2013). The cost of a match is the number of bits that differ.

use std::ops::Range;

use image::GrayImage;
use multiscopic_core::{Frame, Fusion, Params, View};
use rayon::prelude::*;

use super::vector::{LANES, Vector, Vectors};
use crate::images::Frames;

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
    /// The greatest cost of all windows.
    pub const MAX_COST: u16 = 31;

    /// How far the window reaches to each side, and up and down.
    pub const fn radius(self) -> [usize; 2] {
        match self {
            Census::Window5x5 => [2, 2],
            Census::Window7x7 => [3, 3],
            Census::Window9x7 => [4, 3],
        }
    }

    /// Bits of a description, which is the greatest cost: of each two opposite pixels one.
    pub const fn bits(self) -> usize {
        let [rx, ry] = self.radius();
        ((2 * rx + 1) * (2 * ry + 1) - 1) / 2
    }

    /// Where the pixels lie that are compared with their opposites, in the order of the bits.
    fn offsets(self) -> impl Iterator<Item = [isize; 2]> {
        let [rx, ry] = self.radius().map(|radius| radius as isize);
        let all = (-ry..=0).flat_map(move |dy| (-rx..=rx).map(move |dx| [dx, dy]));
        all.take(self.bits())
    }
}

/// How an image is turned so that matches of rising disparity follow each other in its lines.
#[derive(Clone, Copy, Debug)]
enum Orientation {
    Upright,
    /// Columns from the last one on.
    Mirrored,
    /// Columns as lines.
    Transposed,
    /// Columns as lines, from the last row on.
    TransposedMirrored,
}

impl Orientation {
    fn of(view: View) -> Orientation {
        match view {
            View::Left => Orientation::Upright,
            View::Right => Orientation::Mirrored,
            View::Top => Orientation::Transposed,
            View::Bottom => Orientation::TransposedMirrored,
        }
    }

    fn is_transposed(self) -> bool {
        matches!(self, Orientation::Transposed | Orientation::TransposedMirrored)
    }

    fn is_mirrored(self) -> bool {
        matches!(self, Orientation::Mirrored | Orientation::TransposedMirrored)
    }

    /// Where an offset points to in the turned image.
    fn turn(self, [dx, dy]: [isize; 2]) -> [isize; 2] {
        let [dx, dy] = if self.is_transposed() { [dy, dx] } else { [dx, dy] };
        [if self.is_mirrored() { -dx } else { dx }, dy]
    }
}

/// The descriptions of the pixels of an image, line by line, the bytes of each line apart: first all first bytes, then all second ones.
#[derive(Debug)]
struct Lines {
    /// Pixels in a line, and in it with what pads it.
    length: usize,
    stride: usize,
    /// Pixels that pad a line in front.
    front: usize,
    /// Bytes of a description.
    bytes: usize,
    data: Vec<u8>,
}

impl Lines {
    /// Those of an image turned to an `orientation`, with `[front, back]` pixels of nothing around each line.
    fn new(image: &GrayImage, census: Census, orientation: Orientation, [front, back]: [usize; 2]) -> Lines {
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
                let described = &mut line[bit / 8 * stride + front..][..length];
                for ((byte, a), b) in described.iter_mut().zip(samples_at(1)).zip(samples_at(-1)) {
                    *byte |= u8::from(a < b) << (bit % 8);
                }
            }
        });
        Lines { length, stride, front, bytes, data }
    }

    /// A line, whose bytes are [`stride`](Lines::stride) apart.
    #[inline(always)]
    fn line(&self, y: usize) -> &[u8] {
        &self.data[y * self.bytes * self.stride..][..self.bytes * self.stride]
    }
}

/// The fused costs of all pixels, made when they are asked for.
#[derive(Debug)]
pub(super) struct Costs<'a> {
    params: &'a Params,
    center: Lines,
    views: Vec<(View, Lines)>,
}

impl<'a> Costs<'a> {
    /// Describes the centre of `frames` and the views of `params`.
    pub fn new(frames: &Frames, params: &'a Params, census: Census) -> Costs<'a> {
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        let least = isize::from(params.min_disparity());
        // As far as the candidates of the first and the last pixel reach.
        let padding = [(-least).max(0) as usize, least.max(0) as usize + params.num_disparities().next_multiple_of(LANES)];
        let lines = |view| Lines::new(image(Frame::View(view)), census, Orientation::of(view), padding);
        Costs {
            params,
            center: Lines::new(image(Frame::Center), census, Orientation::Upright, [0, 0]),
            views: params.views().iter().map(|view| (view, lines(view))).collect(),
        }
    }

    /// Puts the costs of row `v` into `row`, whose pixels are `lanes` apart. What does not exist is `u16::MAX`.
    #[inline(always)]
    pub fn row<I: Vectors>(&self, isa: I, v: usize, lanes: usize, row: &mut [u16]) {
        match (self.center.bytes, &self.views[..]) {
            (2, views) => self.row_of::<I, 2, 4>(isa, views, v, lanes, row),
            (3, views) => self.row_of::<I, 3, 4>(isa, views, v, lanes, row),
            (_, [view]) => self.row_of::<I, 4, 1>(isa, std::slice::from_ref(view), v, lanes, row),
            (_, views @ [_, _]) => self.row_of::<I, 4, 2>(isa, views, v, lanes, row),
            (_, views) => self.row_of::<I, 4, 4>(isa, views, v, lanes, row),
        }
    }

    /// As [`row`](Costs::row), for at most `V` views.
    #[inline(always)]
    fn row_of<I: Vectors, const BYTES: usize, const V: usize>(
        &self,
        isa: I,
        views: &[(View, Lines)],
        v: usize,
        lanes: usize,
        row: &mut [u16],
    ) {
        let (center, count) = (self.center.line(v), self.params.num_disparities());
        let none = isa.splat(u16::MAX);
        for (u, fused) in row.chunks_exact_mut(lanes).enumerate() {
            let mut described = [0; BYTES];
            for (byte, described) in described.iter_mut().enumerate() {
                *described = center[byte * self.center.stride + u];
            }
            let mut candidates: [Option<Candidates<BYTES>>; V] = [const { None }; V];
            for (candidates, (view, lines)) in candidates.iter_mut().zip(views) {
                *candidates = Some(Candidates::new(self.params, *view, lines, [u, v]));
            }
            for (block, fused) in fused.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let mut costs = [none; V];
                for (costs, candidates) in costs.iter_mut().zip(candidates.iter().flatten()) {
                    *costs = candidates.costs(isa, described, block, count);
                }
                fuse(isa, self.params.fusion(), costs).store(fused);
            }
        }
    }
}

/// What a pixel is compared with in a view.
struct Candidates<'a, const BYTES: usize> {
    /// The bytes of the descriptions, from that of the smallest disparity on.
    bytes: [&'a [u8]; BYTES],
    /// Where the view is available.
    available: Range<u16>,
}

impl<'a, const BYTES: usize> Candidates<'a, BYTES> {
    #[inline(always)]
    fn new(params: &Params, view: View, lines: &'a Lines, [u, v]: [usize; 2]) -> Candidates<'a, BYTES> {
        let (coordinate, line) = if view.is_horizontal() { (u, v) } else { (v, u) };
        let position = if view.sign() > 0 { coordinate } else { lines.length - 1 - coordinate };
        let start = (position + lines.front).wrapping_add_signed(params.min_disparity().into());
        let line = lines.line(line);
        let mut bytes = [line; BYTES];
        for (byte, bytes) in bytes.iter_mut().enumerate() {
            *bytes = &line[byte * lines.stride + start..];
        }
        let available = view.available(coordinate, lines.length, params.min_disparity(), params.num_disparities());
        Candidates { bytes, available }
    }

    /// The costs of a block of disparities, of which there are `count` in all.
    #[inline(always)]
    fn costs<I: Vectors>(&self, isa: I, center: [u8; BYTES], block: usize, count: usize) -> I::Vector {
        let first = block * LANES;
        let mut bytes = [&[0; LANES]; BYTES];
        for (block, bytes) in bytes.iter_mut().zip(self.bytes) {
            *block = bytes[first..].first_chunk().expect("lines are padded");
        }
        let costs = isa.differing(center, bytes);
        let Range { start, end } = self.available;
        if start == 0 && usize::from(end) == count && first + LANES <= count {
            return costs;
        }
        let (none, indices) = (isa.splat(u16::MAX), isa.load(&INDICES));
        let (start, end) = (isa.splat(start.saturating_sub(first as u16)), isa.splat(end.saturating_sub(first as u16)));
        start.if_greater(indices, none, end.if_greater(indices, costs, none))
    }
}

/// The number of each lane.
static INDICES: [u16; LANES] = {
    let mut indices = [0; LANES];
    let mut i = 0;
    while i < LANES {
        indices[i] = i as u16;
        i += 1;
    }
    indices
};

/// Fuses costs on the scale of the rule: see [`Fusion::fuse`]. What does not exist is `u16::MAX`, and no other cost reaches it.
#[inline(always)]
fn fuse<I: Vectors, const V: usize>(isa: I, fusion: Fusion, mut costs: [I::Vector; V]) -> I::Vector {
    let twice = |cost: I::Vector| cost.add(cost);
    let thrice = |cost: I::Vector| cost.add(cost).add(cost);
    let none = isa.splat(u16::MAX);
    match fusion {
        Fusion::Min => costs.into_iter().fold(none, |least, cost| least.min(cost)),
        Fusion::Mean => {
            let (zero, one) = (isa.splat(0), isa.splat(1));
            let (mut sum, mut count) = (zero, zero);
            for cost in costs {
                sum = sum.add(none.if_greater(cost, cost, zero));
                count = count.add(none.if_greater(cost, one, zero));
            }
            let mean = count.if_greater(zero, twice(twice(thrice(sum))), none);
            let mean = count.if_greater(one, twice(thrice(sum)), mean);
            let mean = count.if_greater(isa.splat(2), twice(twice(sum)), mean);
            count.if_greater(isa.splat(3), thrice(sum), mean)
        }
        Fusion::Heuristic => {
            // In ascending order, by exchange.
            for i in 0..V {
                for j in i + 1..V {
                    (costs[i], costs[j]) = (costs[i].min(costs[j]), costs[i].max(costs[j]));
                }
            }
            let at = |i: usize| if i < V { costs[i % V] } else { none };
            let (c1, c2, c3) = (at(0), at(1), at(2));
            // What does not exist is above three times any cost.
            let several = c3.if_greater(thrice(c2), thrice(c1.add(c2)), twice(c1.add(c2).add(c3)));
            none.if_greater(c2, several, twice(thrice(c1)))
        }
    }
}
