//! A line's way through the sums: down the columns of the blocks, and along them.

use core::array;

use crate::{
    Disparity, Params, Region,
    availability::{Segments, uniform_columns},
    kernel::{Block, Blocks, Change, Isa, Lane, Rule, Steps},
    lines::{Frames, Lines},
    selection::{Exact, Selection},
};

/// The samples that two lines of the centre, which may be virtual, are compared with, in `columns` columns.
pub(crate) fn steps<'a, const V: usize>(frames: &'a Frames<'_>, lines: Change<i32>, columns: usize) -> Steps<'a, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    Steps::new(at(&frames.center), array::from_fn(|_| at(views.next().unwrap_or(&frames.center))), columns)
}

/// Adds the entering line to the sums of all columns, of `vectors` vectors in each view.
#[inline(always)]
pub(crate) fn prime<I: Isa, const V: usize>(isa: I, columns: &mut [I::Sums], vectors: usize, mut steps: Steps<'_, V>) {
    for column in columns.chunks_exact_mut((V * vectors).max(1)) {
        isa.prime(&mut steps, column);
    }
}

/// The most pixels in a batch.
const MAX_BATCH: usize = 16;

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The sums of each column of the span, view by view.
    pub columns: &'a mut [I::Sums],
    /// As many zeros as the sums of a column.
    pub zeros: &'a [I::Sums],
    /// What every column sum has too much.
    pub bias: u16,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The fused costs of a batch of pixels.
    pub fused: &'a mut [I::Costs],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Moves the blocks down by a step and along line `v`, and writes its disparities.
    #[inline(always)]
    pub fn run(mut self, v: usize, mut steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let (isa, params, vectors, bias) = (self.isa, self.params, self.blocks.len(), self.bias);
        for costs in self.blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for x in 0..2 * params.radius() {
            self.advance(x, None, &mut steps);
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Segments::new(params, uniform.start, v);
        let (start, end) = (self.region.columns().start, self.region.columns().end);
        let complete = of_uniform.are_complete(params);
        let mut leasts = [L::MAX; MAX_BATCH];
        for (pixels, u) in out.chunks_mut(I::BATCH.min(MAX_BATCH)).zip((start..end).step_by(I::BATCH.min(MAX_BATCH))) {
            for ((least, u), i) in leasts.iter_mut().zip(u..).zip(0..pixels.len()) {
                let x = u - start;
                self.advance(x + 2 * params.radius(), x.checked_sub(1), &mut steps);
                let fused = self.fused.get_mut(i * vectors..(i + 1) * vectors).unwrap_or_default();
                *least = match uniform.contains(&u) {
                    true if complete => selection.fuse(self.blocks, fused),
                    true => selection.fuse_segments(&of_uniform, self.blocks, fused),
                    false => selection.fuse_segments(&Segments::new(params, u, v), self.blocks, fused),
                };
            }
            for (((pixel, &least), u), i) in pixels.iter_mut().zip(&leasts).zip(u..).zip(0..) {
                let fused = self.fused.get(i * vectors..(i + 1) * vectors).unwrap_or_default();
                let columns = &*self.columns;
                *pixel = selection.disparity(least, fused, || {
                    let columns = columns.get((u - start) * V * vectors..).unwrap_or_default();
                    Exact { params, u, v, columns, vectors, bias }
                });
            }
        }
    }

    /// Moves column `x` of the span down, and the blocks on by it; column `left`, if any, leaves them.
    #[inline(always)]
    fn advance(&mut self, x: usize, left: Option<usize>, steps: &mut Steps<'_, V>) -> Option<()> {
        let sums = V * self.blocks.len();
        let (before, column) = self.columns.split_at_mut_checked(x * sums)?;
        let left = match left {
            Some(left) => before.get(left * sums..)?.get(..sums)?,
            None => self.zeros.get(..sums)?,
        };
        self.isa.slide(steps, column.get_mut(..sums)?, left, self.blocks);
        Some(())
    }
}
