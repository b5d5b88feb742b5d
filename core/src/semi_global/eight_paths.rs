//! Semi-global matching along eight paths, in bounded memory.
//!
//! ```text
//! cost(p, d)                                     // given by the caller, line by line, as often as is asked for
//! L_r(p, d) = cost(p, d) + min(L_r(p - r, d), L_r(p - r, d +- 1) + P1, min_i L_r(p - r, i) + P2) - min_i L_r(p - r, i)
//! sum(p, d) = sum over eight directions r of L_r(p, d)
//!
//! ascend(whole frame): paths from below only     // last line to first
//!     keep the three paths' costs in the first line of each band from the third on
//!     write the excess of the first band
//! for each line v, downwards:
//!     if v begins a band: ascend(this band) from the kept costs of the next, and write its excess
//!     extend the three paths from above and the one from the left
//!     extend the path from the right, and at each pixel: sum = 8 cost + excess of five paths + excess from below
//!     select the winner, and refine it by two lines
//! ```
//!
//! Without bands, the excess of the paths from below would take a byte for each candidate of the frame. With bands of `n`
//! lines of `h`, the excess takes `n` lines of bytes and the kept costs take `3 (h / n - 2)`; [`Bands::new`] finds the least
//! sum, near `n = sqrt(3 h)`. The price is that costs are computed three times and the paths from below extended twice.
//!
//! Paths add up their *excess* `L_r - cost`, which is at most `P2`: five paths fit a byte (5 x 51 = 255), so the excess of
//! those from below is added later, in 16 bits. A slot holds the path costs of one pixel. Three rings of slots turn by a
//! pixel from line to line ([`Slots`]), so that a diagonal path finds its predecessor without a copy.
//!
//! Invariants: `paths_from_below` is at the line that was extended last; `kept_costs` has the costs of bands below the present
//! one only; `excess` belongs to the band of `next`.

use core::ops::Range;

use super::path_lines::{PathLines, PathSweep, Slots};
use crate::{
    Disparity, Memory, MemoryTooSmall, SemiGlobalParams, infallible,
    kernel::{Isa, Kernel, PixelPaths, RunPenalties, Slot, Step, Work, as_vectors, as_vectors_mut},
    memory::{Lender, PathShape, align, vector_bytes},
};

/// The paths that lead to a pixel.
const PATHS: u16 = 8;

/// Sums of path costs and disparities along eight paths: those of [`SemiGlobalParams`], and three from below.
///
/// The sum of a candidate is `8 C + sum of E`, as [`SemiGlobalParams`] defines them. Disparities are selected and refined by
/// these sums as they are there.
///
/// A first pass goes up. It keeps the costs of the paths from below for one line in several only. A second pass goes down, band
/// by band. For each band, it extends the paths from below again, from the costs that were kept, and keeps what they add to the
/// matching costs. So the caller computes the matching costs of each line up to three times.
///
/// ```
/// use multiscopic_core::kernel::{DistanceFusion, Portable};
/// use multiscopic_core::network::{CensusPair, CensusPairLines};
/// use multiscopic_core::{Census, EightPaths, Fusion, SearchConfig, SemiGlobalCost, SemiGlobalParams, Views, valid};
///
/// const PAIR: CensusPair = CensusPair::BothWays;
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::STEREO, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(40, 30) };
/// const PARAMS: SemiGlobalParams = valid(SEARCH.semi_global(SemiGlobalCost::Census(Census::Window9x7)));
/// // A texture, seen three pixels further to the left.
/// let pixel = |u: usize, v: usize| (u * (u + 3 * v) % 61) as u8;
/// let frame = |shift: usize| -> [u8; 1200] { std::array::from_fn(|i| pixel(i % 40 + shift, i / 40)) };
/// let (center, right) = (frame(0), frame(3));
///
/// let mut lent = [0; CensusPairLines::<Portable<4>>::memory_words(PAIR, PARAMS.search())];
/// let mut lines = CensusPairLines::new(Portable::<4>, PAIR, PARAMS.search(), &[&center, &right], &mut lent)?;
/// let mut lent = [0; EightPaths::<Portable<4>>::memory_words(&PARAMS)];
/// let mut paths = EightPaths::new(Portable::<4>, &PARAMS, &center, &mut lent)?;
/// let mut costs = |v: usize, costs: &mut [u8]| lines.line(v, DistanceFusion::Rule(Fusion::Min), costs);
/// while let Some(line) = paths.next_line(&mut costs) {
///     assert_eq!(line.disparities[20].map(|d| f32::from(d).round()), Some(3.0));
/// }
/// # Ok::<(), multiscopic_core::MemoryTooSmall>(())
/// ```
#[derive(Debug)]
pub struct EightPaths<'m, 'f, I> {
    isa: I,
    params: SemiGlobalParams,
    /// The centre, line by line.
    center: &'f [u8],
    shape: PathShape,
    /// The paths of the second pass, with the costs and the excess of the line at hand, in either pass.
    paths_from_above: PathLines<'m>,
    /// The paths from the bottom left, the bottom and the bottom right.
    paths_from_below: [Slots<'m>; 3],
    /// The costs of these paths in the first line of each band from the third on.
    kept_costs: &'m mut [u8],
    /// The lines of a band.
    band: usize,
    /// The excess of the paths from below over the costs of the lines of a band.
    excess: &'m mut [u8],
    sums: &'m mut [u16],
    disparities: &'m mut [Option<Disparity>],
    /// The next line.
    next: usize,
}

/// A line of [`EightPaths`].
#[derive(Clone, Copy, Debug)]
pub struct EightPathsLine<'a> {
    /// The line.
    pub v: usize,
    /// The sums of path costs, at most 1424, pixel by pixel: the disparities of the search, rounded up to whole vectors.
    /// `u16::MAX` where a candidate does not exist, and past the last disparity.
    pub sums: &'a [u16],
    /// The disparity of each pixel, or `None` where no candidate exists.
    pub disparities: &'a [Option<Disparity>],
}

// The greatest sum.
const _: () = assert!(8 * SemiGlobalParams::MAX_COST as u16 + 8 * crate::PathPenalties::MAX as u16 == 1424);

/// The division of a frame's lines into bands.
#[derive(Clone, Copy, Debug)]
struct Bands {
    shape: PathShape,
    height: usize,
    /// The lines of a band. The last one may have fewer.
    lines: usize,
}

impl Bands {
    /// The bands that take the least memory.
    const fn new(shape: PathShape, height: usize) -> Bands {
        let mut best = Bands { shape, height, lines: 1 };
        let mut lines = 2;
        while lines <= height {
            let bands = Bands { lines, ..best };
            // Of as much memory, larger bands take less time.
            if bands.kept_bytes() + bands.excess_bytes() <= best.kept_bytes() + best.excess_bytes() {
                best = bands;
            }
            lines += 1;
        }
        best
    }

    /// The bytes of the path costs that the first pass keeps. It ends with the first band, and so has the costs of the second
    /// one. In the last band, paths begin.
    const fn kept_bytes(&self) -> usize {
        infallible::div_ceil(self.height, self.lines).saturating_sub(2) * 3 * self.shape.line_bytes()
    }

    /// The bytes of what paths add to the costs of a band.
    const fn excess_bytes(&self) -> usize {
        self.lines * self.shape.line_bytes()
    }
}

impl<'m, 'f, I: Isa> EightPaths<'m, 'f, I> {
    /// The words of memory that [`new`](EightPaths::new) needs.
    pub const fn memory_words(params: &SemiGlobalParams) -> usize {
        let shape = PathShape::new::<I>(params);
        let (bands, vector) = (Bands::new(shape, params.search().height()), vector_bytes::<I>());
        let Memory { costs, paths, samples, .. } = Memory::semi_global::<I>(params);
        let bytes = costs
            + paths
            + samples
            + 3 * align(shape.slots_bytes(), vector)
            + align(bands.kept_bytes(), vector)
            + align(bands.excess_bytes(), vector)
            + align(2 * shape.line_bytes(), vector)
            + align(2 * shape.width, vector);
        infallible::div_ceil(bytes, 4)
    }

    /// A pass with an instruction set.
    ///
    /// Of the parameters, the matching cost, the fusion and the views do not matter. `center` has the grey values of the centre,
    /// line by line. `memory` has at least [`memory_words`](EightPaths::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        isa: I,
        params: &SemiGlobalParams,
        center: &'f [u8],
        memory: &'m mut [u32],
    ) -> Result<EightPaths<'m, 'f, I>, MemoryTooSmall> {
        let shape = PathShape::new::<I>(params);
        let bands = Bands::new(shape, params.search().height());
        let mut lender = Lender::new::<I>(memory, EightPaths::<I>::memory_words(params))?;
        let paths_from_above = PathLines::new(params, shape, |bytes| lender.bytes(bytes))?;
        let mut slots = |slope| Ok(Slots::new(slope, shape, lender.bytes(shape.slots_bytes())?, paths_from_above.start));
        Ok(EightPaths {
            isa,
            params: *params,
            center,
            paths_from_below: [slots(1)?, slots(0)?, slots(-1)?],
            shape,
            paths_from_above,
            kept_costs: lender.bytes(bands.kept_bytes())?,
            band: bands.lines,
            excess: lender.bytes(bands.excess_bytes())?,
            sums: lender.halfwords(shape.line_bytes())?,
            disparities: lender.halfwords(shape.width)?,
            next: 0,
        })
    }

    /// The samples of the centre in line `v`.
    fn center(&self, v: usize) -> &'f [u8] {
        let width = self.shape.width;
        self.center.get(v * width..(v + 1) * width).unwrap_or_default()
    }

    /// The place where the path costs of line `v` are kept, if it is the first one of a band from the third on.
    fn kept_costs_at(&self, v: usize) -> Option<Range<usize>> {
        let first = v.checked_sub(2 * self.band).filter(|lines| lines.is_multiple_of(self.band))?;
        let bytes = 3 * self.shape.line_bytes();
        let start = first.checked_div(self.band)? * bytes;
        Some(start..start + bytes)
    }
}

impl<I: Kernel> EightPaths<'_, '_, I> {
    /// Computes the next line, from the top of the frame, or `None` after the last.
    ///
    /// `costs` computes the matching costs of any line: as many for each pixel as sums, at most
    /// [`SemiGlobalParams::MAX_COST`], and 255 where a candidate does not exist and past the last disparity. Before the first
    /// line it is called for all lines, from the last one upwards; then in each band upwards and downwards.
    pub fn next_line(&mut self, costs: &mut impl FnMut(usize, &mut [u8])) -> Option<EightPathsLine<'_>> {
        let (v, height) = (self.next, self.params.search().height());
        if v >= height {
            return None;
        }
        if v == 0 {
            self.ascend(costs, 0, height);
        } else if v.is_multiple_of(self.band) {
            self.ascend(costs, v, (v + self.band).min(height));
        }
        costs(v, self.paths_from_above.costs);
        self.paths_from_above.enter_line(self.center(v));
        let bytes = self.shape.line_bytes();
        let excess = self.excess.get(v.checked_rem(self.band)? * bytes..)?.get(..bytes)?;
        self.isa.compiled(ExtendAndSelect {
            isa: self.isa,
            params: &self.params,
            paths: &mut self.paths_from_above,
            excess,
            sums: self.sums,
            disparities: self.disparities,
        });
        self.next += 1;
        Some(EightPathsLine { v, sums: self.sums, disparities: self.disparities })
    }

    /// Extends the paths from below through the lines above `bottom` up to `top`, the first line of a band. Keeps what they add
    /// to the costs of this band, and the path costs of the first line of the bands below it.
    fn ascend(&mut self, costs: &mut impl FnMut(usize, &mut [u8]), top: usize, bottom: usize) {
        let (shape, height) = (self.shape, self.params.search().height());
        let line = shape.line_bytes();
        match self.kept_costs_at(bottom).and_then(|kept| self.kept_costs.get(kept)) {
            Some(kept) if bottom < height => {
                let kept = infallible::parts(kept, line);
                self.paths_from_below.iter_mut().zip(kept).for_each(|(slots, costs)| slots.load(costs, shape.depth));
            }
            _ => self.paths_from_below.iter_mut().for_each(|slots| slots.begin(self.paths_from_above.start)),
        }
        for v in (top..bottom).rev() {
            let (here, below) = (self.center(v), self.center((v + 1).min(height - 1)));
            let kept = self.kept_costs_at(v);
            let PathLines { costs: all_costs, excess: unused, start, p2, .. } = &mut self.paths_from_above;
            costs(v, all_costs);
            self.paths_from_below.iter_mut().for_each(|slots| slots.enter_line(start));
            let is_in_band = v < top + self.band;
            let excess = if is_in_band { self.excess.get_mut((v - top) * line..).unwrap_or_default() } else { &mut **unused };
            self.isa.compiled(ExtendFromBelow {
                isa: self.isa,
                shape,
                costs: all_costs,
                excess,
                paths_from_below: &mut self.paths_from_below,
                penalties: RunPenalties { p1: self.params.penalties().p1(), p2, here, above: below },
            });
            if let Some(kept) = kept.filter(|_| !is_in_band).and_then(|kept| self.kept_costs.get_mut(kept)) {
                let kept = infallible::parts_mut(kept, line);
                self.paths_from_below.iter().zip(kept).for_each(|(slots, costs)| slots.store(costs, shape.depth));
            }
        }
    }
}

/// Extends the paths from below by a line.
struct ExtendFromBelow<'a, 'm, I> {
    isa: I,
    shape: PathShape,
    costs: &'a [u8],
    /// The excess of the paths over the costs, to be written.
    excess: &'a mut [u8],
    paths_from_below: &'a mut [Slots<'m>; 3],
    /// The penalties, with the line below as the one above.
    penalties: RunPenalties<'a>,
}

impl<I: Kernel> Work for ExtendFromBelow<'_, '_, I> {
    #[inline(always)]
    fn run(self) {
        let ExtendFromBelow { isa, shape: PathShape { width, depth }, costs, excess, paths_from_below, penalties } = self;
        let stride = Slot::bytes(depth);
        let mut pixels = costs.chunks_exact(depth.max(1)).zip(excess.chunks_exact_mut(depth.max(1)));
        let mut start = 0;
        while start < width {
            let length = paths_from_below.iter().map(|slots| slots.run_length(start)).fold(width - start, usize::min);
            let mut runs = paths_from_below.each_mut().map(|slots| slots.run(start, length));
            for (i, (costs, excess)) in pixels.by_ref().take(length).enumerate() {
                let [_, p2_a, p2_b, p2_c] = penalties.forward_p2(start + i);
                let [a, b, c] = runs.each_mut().map(|slots| {
                    let slots = slots.get_mut(i * stride..(i + 2) * stride).unwrap_or_default();
                    slots.split_at_mut_checked(stride).unwrap_or_default()
                });
                let steps = [(a, p2_a), (b, p2_b), (c, p2_c)].map(|((after, before), p2)| Step { before, after, p2 });
                isa.extend::<3, true>(as_vectors::<I>(costs), steps, penalties.p1, as_vectors_mut::<I>(excess));
            }
            start += length;
        }
    }
}

/// Extends the paths from above and along a line, and selects its disparities.
struct ExtendAndSelect<'a, 'm, I> {
    isa: I,
    params: &'a SemiGlobalParams,
    paths: &'a mut PathLines<'m>,
    /// The excess of the paths from below over the costs.
    excess: &'a [u8],
    sums: &'a mut [u16],
    disparities: &'a mut [Option<Disparity>],
}

impl<I: Kernel> Work for ExtendAndSelect<'_, '_, I> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(self) {
        let ExtendAndSelect { isa, params, paths, excess: from_below, sums, disparities } = self;
        PathSweep { isa, params, paths, disparities: &mut [], peaks: None }.forward();
        let PathShape { depth, .. } = PathShape::new::<I>(params);
        let min_disparity = params.search().min_disparity();
        paths.extend_backward(isa, params, |PixelPaths { column, costs, excess, .. }| {
            let candidates = column * depth..(column + 1) * depth;
            let (Some(sums), Some(from_below)) = (sums.get_mut(candidates.clone()), from_below.get(candidates)) else { return };
            for (((sum, &cost), &excess), &from_below) in sums.iter_mut().zip(costs).zip(excess).zip(from_below) {
                let exists = cost != u8::MAX;
                *sum = if exists { PATHS * u16::from(cost) + u16::from(excess) + u16::from(from_below) } else { u16::MAX };
            }
            if let Some(disparity) = disparities.get_mut(column) {
                *disparity = select(min_disparity, sums);
            }
        });
    }
}

/// The disparity of a pixel by its sums.
#[inline(always)]
fn select(min_disparity: i16, sums: &[u16]) -> Option<Disparity> {
    let least = sums.iter().copied().fold(u16::MAX, u16::min);
    if least == u16::MAX {
        return None;
    }
    let index = sums.iter().position(|&sum| sum == least)?;
    let d = min_disparity.wrapping_add(index as i16);
    let around = index.checked_sub(1).and_then(|before| sums.get(before..)?.first_chunk());
    match around {
        Some(&[before, _, after]) if before.max(after) != u16::MAX => {
            Disparity::refine_equiangular(d, before.into(), least.into(), after.into())
        }
        _ => Disparity::whole(d),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Census, Fusion, SearchConfig, SemiGlobalCost, Views, kernel::Portable};

    #[test]
    fn small_frames_take_less_than_120_kilobytes() {
        let bytes = |width, height, count| {
            let search = SearchConfig {
                width,
                height,
                views: Views::HORIZONTAL,
                fusion: Fusion::Min,
                min_disparity: 0,
                num_disparities: count,
            }
            .checked()
            .unwrap();
            let params = SemiGlobalParams::new(search, SemiGlobalCost::Census(Census::Window9x7)).unwrap();
            4 * EightPaths::<Portable<8>>::memory_words(&params)
        };
        assert_eq!(bytes(160, 120, 16), 116_672);
        assert_eq!(bytes(320, 240, 32), 611_728);
    }

    #[test]
    fn bands_take_the_least_memory() {
        let shape = PathShape { width: 1, depth: 1 };
        for height in 1..300_usize {
            // Path costs take three bytes, and what paths add takes one.
            let bytes = |lines: usize| 3 * height.div_ceil(lines).saturating_sub(2) + lines;
            let bands = Bands::new(shape, height);
            assert_eq!(bands.kept_bytes() + bands.excess_bytes(), bytes(bands.lines));
            assert_eq!((1..=height).map(bytes).min(), Some(bytes(bands.lines)), "{height} lines");
        }
    }
}
