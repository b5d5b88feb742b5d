//! Matching costs by the centre-symmetric census transform.
//!
//! A pixel is described by one bit for each pair of pixels opposite to each other in a window around it: which of them is brighter
//! (Spangenberg, Langner and Rojas, "Weighted semi-global matching and center-symmetric census transform for robust driver
//! assistance", 2013). The cost of a match is the number of bits that differ.

use image::GrayImage;
use multiscopic_core::{Frame, Params, View};
use rayon::prelude::*;

use super::LANES;
use crate::{Frames, volume};

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

/// The cost of a match that lies outside its view.
const OUTSIDE: u8 = u8::MAX;

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

    /// Puts the costs of row `v` into `row`, whose pixels are `lanes` apart. What does not exist is `u16::MAX`. `scratch` is any memory.
    #[inline(always)]
    pub fn row(&self, v: usize, lanes: usize, scratch: &mut Vec<u8>, row: &mut [u16]) {
        match self.center.bytes {
            2 => self.row_of::<2>(v, lanes, scratch, row),
            3 => self.row_of::<3>(v, lanes, scratch, row),
            _ => self.row_of::<4>(v, lanes, scratch, row),
        }
    }

    #[inline(always)]
    fn row_of<const BYTES: usize>(&self, v: usize, lanes: usize, scratch: &mut Vec<u8>, row: &mut [u16]) {
        scratch.resize(4 * lanes, 0);
        let center = self.center.line(v);
        for (u, fused) in row.chunks_exact_mut(lanes).enumerate() {
            let described = std::array::from_fn(|byte| center[byte * self.center.stride + u]);
            for ((view, lines), costs) in self.views.iter().zip(scratch.chunks_exact_mut(lanes)) {
                self.view::<BYTES>(*view, lines, [u, v], described, costs);
            }
            self.fuse(lanes, scratch, fused);
            // The lanes too many.
            fused[self.params.num_disparities()..].fill(u16::MAX);
        }
    }

    /// The costs of a pixel in a view.
    #[inline(always)]
    fn view<const BYTES: usize>(&self, view: View, lines: &Lines, [u, v]: [usize; 2], center: [u8; BYTES], costs: &mut [u8]) {
        let (coordinate, line) = if view.is_horizontal() { (u, v) } else { (v, u) };
        let position = if view.sign() > 0 { coordinate } else { lines.length - 1 - coordinate };
        let start = (position + lines.front).wrapping_add_signed(self.params.min_disparity().into());
        let line = lines.line(line);
        let bytes: [&[u8]; BYTES] = std::array::from_fn(|byte| &line[byte * lines.stride + start..][..costs.len()]);
        for (block, costs) in costs.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let bytes = bytes.map(|byte| &byte.as_chunks::<LANES>().0[block]);
            for i in 0..LANES {
                let mut differing = 0;
                for byte in 0..BYTES {
                    differing += (bytes[byte][i] ^ center[byte]).count_ones() as u8;
                }
                costs[i] = differing;
            }
        }
        let count = self.params.num_disparities();
        let available = view.available(coordinate, lines.length, self.params.min_disparity(), count);
        let available = usize::from(available.start)..usize::from(available.end);
        if available != (0..count) {
            costs[..available.start].fill(OUTSIDE);
            costs[available.end..].fill(OUTSIDE);
        }
    }

    /// Fuses the views' costs of a pixel.
    #[inline(always)]
    fn fuse(&self, lanes: usize, costs: &[u8], fused: &mut [u16]) {
        let mut wide = [[0u16; LANES]; 4];
        for (block, fused) in fused.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let views = wide.iter_mut().zip(costs.chunks_exact(lanes)).take(self.views.len());
            for (wide, costs) in views {
                for (wide, &cost) in wide.iter_mut().zip(&costs.as_chunks::<LANES>().0[block]) {
                    *wide = if cost == OUTSIDE { u16::MAX } else { cost.into() };
                }
            }
            let [a, b, c, d] = &wide;
            volume::fuse(self.params.fusion(), &[&a[..], b, c, d][..self.views.len()], fused);
        }
    }
}
