//! The paths through a row.

use std::ops::Range;

use multiscopic_core::{
    Disparity, Search,
    kernel::{Along, ByteVector, Kernel, Step, as_vectors, as_vectors_mut},
};

use super::path_block::{COLUMNS, PathBlock};
use crate::stereo::{cost::Cost, optimization::winner};

/// The paths of a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// Whether the pass starts at the last row.
    pub upwards: bool,
    /// Whether there are paths along the row, in both directions.
    pub along_rows: bool,
    /// Whether there are diagonal paths from row to row.
    pub diagonals: bool,
}

/// What paths charge, and the samples of the centre by which P2 is lowered.
#[derive(Clone, Copy)]
pub(super) struct Penalties<'a> {
    pub p1: u8,
    /// By the change of brightness.
    pub p2: &'a [u8; 256],
    /// The samples of the row.
    pub here: &'a [u8],
    /// The samples of the row before in the pass.
    pub above: &'a [u8],
}

impl Penalties<'_> {
    /// P2 between a pixel of the row and another sample.
    #[inline(always)]
    fn p2(&self, u: usize, other: u8) -> u8 {
        self.p2[usize::from(self.here[u].abs_diff(other))]
    }
}

/// The paths of the row before, block by block as far as they have arrived; `None` if the row is the first.
pub(super) type Above<'a> = Option<&'a [Vec<PathBlock>]>;

/// A row's costs, and what its paths add to them.
pub(super) struct RowCosts<'a> {
    pub stride: usize,
    pub costs: &'a [u8],
    pub excess: &'a mut [u8],
}

impl RowCosts<'_> {
    /// Extends the paths from the row before through the columns `here`, a block, and the one from the left
    /// unless it is `None`.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    pub fn forward<I: Kernel, const SLOPES: usize, const M: usize>(
        &mut self,
        isa: I,
        penalties: Penalties<'_>,
        mut from_left: Option<&mut Along<I, M>>,
        above: Above<'_>,
        start: &[u8],
        here: Range<usize>,
        mut blocks: [&mut PathBlock; SLOPES],
    ) {
        let (first, width) = (here.start, penalties.here.len());
        for u in here {
            let mut steps = [const { None }; SLOPES];
            for (k, (step, block)) in steps.iter_mut().zip(&mut blocks).enumerate() {
                // One path straight down, or three with slopes of 1, 0 and -1.
                let slope = if SLOPES == 1 { 0 } else { 1 - k as isize };
                let (column, after) = (u.wrapping_add_signed(-slope), block.at_mut(u - first));
                *step = Some(match above {
                    Some(above) if column < width => {
                        let before = above[column / COLUMNS][k].at(column % COLUMNS);
                        Step { before, after, p2: penalties.p2(u, penalties.above[column]) }
                    }
                    _ => Step { before: start, after, p2: 0 },
                });
            }
            let steps = steps.map(|step| step.expect("there is a step for each path"));
            let (costs, excess) = self.pixel::<I>(u);
            isa.extend::<SLOPES, true>(costs, steps, penalties.p1, excess);
            if let Some(from_left) = from_left.as_mut() {
                let p2 = penalties.p2(u, penalties.here[u.saturating_sub(1)]);
                add(isa, excess, from_left.step(isa, costs, penalties.p1, p2));
            }
        }
    }

    /// Extends the path from the right through the row, and calls `done` with each pixel's costs and excess.
    #[inline(always)]
    pub fn backward<I: Kernel, const M: usize>(
        &mut self,
        isa: I,
        penalties: Penalties<'_>,
        mut from_right: Along<I, M>,
        mut done: impl FnMut(usize, &[u8], &[u8]),
    ) {
        let last = penalties.here.len() - 1;
        for u in (0..=last).rev() {
            let (costs, excess) = self.pixel::<I>(u);
            let p2 = penalties.p2(u, penalties.here[last.min(u + 1)]);
            add(isa, excess, from_right.step(isa, costs, penalties.p1, p2));
            let pixel = u * self.stride..(u + 1) * self.stride;
            done(u, &self.costs[pixel.clone()], &self.excess[pixel]);
        }
    }

    /// Calls `done` with each pixel's costs and excess.
    pub fn each(&self, mut done: impl FnMut(usize, &[u8], &[u8])) {
        let pixels = self.costs.chunks_exact(self.stride).zip(self.excess.chunks_exact(self.stride));
        pixels.enumerate().for_each(|(u, (costs, excess))| done(u, costs, excess));
    }

    /// The costs and the excess of a pixel.
    #[inline(always)]
    fn pixel<I: Kernel>(&mut self, u: usize) -> (&[I::Samples], &mut [I::Samples]) {
        let pixel = u * self.stride..(u + 1) * self.stride;
        (as_vectors::<I>(&self.costs[pixel.clone()]), as_vectors_mut::<I>(&mut self.excess[pixel]))
    }
}

/// Adds what a path adds to the costs of a pixel.
#[inline(always)]
fn add<I: Kernel, const M: usize>(isa: I, excess: &mut [I::Samples], added: [I::Bytes; M]) {
    for (excess, added) in excess.iter_mut().zip(added) {
        isa.load_bytes(excess).add(added).store(excess);
    }
}

/// Adds what the paths of a pass add to the costs of a pixel. In the last pass, its costs are added once for
/// each of `paths`; where there is no candidate, the sum is [`NONE`](Cost::NONE).
#[inline(always)]
pub(super) fn add_to_sums(sums: &mut [u16], costs: &[u8], excess: &[u8], paths: Option<u16>) {
    for ((sum, &cost), &excess) in sums.iter_mut().zip(costs).zip(excess) {
        *sum = match paths {
            Some(_) if cost == u8::NONE => u16::NONE,
            Some(paths) => *sum + u16::from(excess) + paths * u16::from(cost),
            None => *sum + u16::from(excess),
        };
    }
}

/// The disparity of a pixel by its sums, as [`select_disparity`](multiscopic_core::select_disparity) selects it.
pub(super) fn select_by_sums(search: &Search, sums: &[u16]) -> Option<Disparity> {
    winner::disparity_refined_by(search, sums, |d, [before, at, after]| {
        Disparity::refine_equiangular(d, before.into(), at.into(), after.into())
    })
}
