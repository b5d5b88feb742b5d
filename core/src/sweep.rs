//! A line's way through the sums: down the columns of the blocks, and along them.

use core::{array, mem};

use crate::{
    Disparity, Params, Region,
    availability::{Segments, uniform_columns},
    kernel::{Block, Blocks, Change, Column, Isa, Lane, Rule},
    lines::{Frames, Lines, Samples},
    selection::{Exact, Selection, Winner},
};

/// The samples that enter and leave the blocks, of the centre and of `V` views.
pub(crate) struct Steps<'a, const V: usize> {
    center: Change<Samples<'a>>,
    views: [Change<Samples<'a>>; V],
}

impl<'a, const V: usize> Steps<'a, V> {
    /// Those of two lines of the centre, which may be virtual.
    pub fn new(frames: &'a Frames<'_>, lines: Change<i32>) -> Steps<'a, V> {
        let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
        let mut views = frames.views.iter().flatten();
        Steps { center: at(&frames.center), views: array::from_fn(|_| at(views.next().unwrap_or(&frames.center))) }
    }

    /// The centre's in column `x` of the span.
    #[inline(always)]
    fn center(&self, x: usize) -> Option<Change<u8>> {
        Some(Change { entering: *self.center.entering.at(x)?.first()?, leaving: *self.center.leaving.at(x)?.first()? })
    }

    /// The `k`-th view's in column `x` of the span, at all disparities.
    #[inline(always)]
    fn view<I: Isa>(&self, k: usize, x: usize, vectors: usize) -> Option<Change<&'a [I::Samples]>> {
        let Change { entering, leaving } = self.views.get(k)?;
        Some(Change {
            entering: I::samples(entering.at(x)?).get(..vectors)?,
            leaving: I::samples(leaving.at(x)?).get(..vectors)?,
        })
    }
}

/// Adds the entering line to the sums of all columns, of `vectors` vectors in each view.
#[inline(always)]
pub(crate) fn prime<I: Isa, const V: usize>(isa: I, columns: &mut [I::Sums], vectors: usize, steps: &Steps<'_, V>) {
    let mut rest = columns;
    for x in 0.. {
        for k in 0..V {
            let Some((column, others)) = mem::take(&mut rest).split_at_mut_checked(vectors) else { return };
            let (Some(center), Some(view)) = (steps.center(x), steps.view::<I>(k, x, vectors)) else { return };
            for (sums, samples) in column.iter_mut().zip(view.entering) {
                isa.load_column(sums).add(isa.differences(center.entering, samples)).store(sums);
            }
            rest = others;
        }
    }
}

/// The most pixels in a batch.
const MAX_BATCH: usize = 16;

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The sums of each column of the span, view by view.
    pub columns: &'a mut [I::Sums],
    /// As many zeros as the sums of a column.
    pub zeros: &'a [I::Sums],
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The fused costs of a batch of pixels.
    pub fused: &'a mut [I::Costs],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Moves the blocks down by a step and along line `v`, and writes its disparities.
    #[inline(always)]
    pub fn run(mut self, v: usize, steps: &Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let (isa, params, vectors) = (self.isa, self.params, self.blocks.len());
        for costs in self.blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for x in 0..2 * params.radius() {
            self.advance(x, None, steps);
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Segments::new(params, uniform.start, v);
        let (start, end) = (self.region.columns().start, self.region.columns().end);
        let mut winners = [Winner::default(); MAX_BATCH];
        let mut u = start;
        while u < end {
            // A batch of pixels that lie in the uniform columns, or all before, or all after them.
            let inside = uniform.contains(&u);
            let border = if inside { uniform.end } else if u < uniform.start { uniform.start } else { end };
            let batch = u..border.min(end).min(u + I::BATCH.min(MAX_BATCH));
            let complete = inside && of_uniform.are_complete(params);
            for (u, i) in batch.clone().zip(0..) {
                let x = u - start;
                self.advance(x + 2 * params.radius(), x.checked_sub(1), steps);
                let fused = self.fused.get_mut(i * vectors..(i + 1) * vectors).unwrap_or_default();
                if complete {
                    selection.fuse(self.blocks, fused);
                } else {
                    let segments = if inside { of_uniform } else { Segments::new(params, u, v) };
                    selection.fuse_segments(&segments, self.blocks, fused);
                }
            }
            let fused = |i: usize| self.fused.get(i * vectors..(i + 1) * vectors).unwrap_or_default();
            for (winner, i) in winners.iter_mut().zip(0..batch.len()) {
                *winner = selection.winner(fused(i));
            }
            let pixels = out.get_mut(batch.start - start..batch.end - start).unwrap_or_default();
            for (((pixel, winner), i), u) in pixels.iter_mut().zip(winners).zip(0..).zip(batch.clone()) {
                let columns = &*self.columns;
                *pixel = selection.disparity(winner, fused(i), || {
                    let columns = columns.get((u - start) * V * vectors..).unwrap_or_default();
                    Exact { params, u, v, columns, vectors }
                });
            }
            u = batch.end;
        }
    }

    /// Moves column `x` of the span down, and the blocks on by it; column `left`, if any, leaves them.
    #[inline(always)]
    fn advance(&mut self, x: usize, left: Option<usize>, steps: &Steps<'_, V>) -> Option<()> {
        let (isa, vectors) = (self.isa, self.blocks.len());
        let (before, mut column) = self.columns.split_at_mut_checked(x * V * vectors)?;
        let mut left = match left {
            Some(left) => before.get(left * V * vectors..)?,
            None => self.zeros,
        };
        let center = steps.center(x)?;
        for k in 0..V {
            let view = steps.view::<I>(k, x, vectors)?;
            let sums;
            (sums, column) = column.split_at_mut_checked(vectors)?;
            let leaving;
            (leaving, left) = left.split_at_checked(vectors)?;
            let samples = view.entering.iter().zip(view.leaving);
            for (((sums, left), block), (entering, leaving)) in sums.iter_mut().zip(leaving).zip(&mut *self.blocks).zip(samples) {
                let moved = isa.advance(isa.load_column(sums), center, Change { entering, leaving });
                moved.store(sums);
                isa.load_block(&block[k]).slide(moved, isa.load_column(left)).store(&mut block[k]);
            }
        }
        Some(())
    }
}
