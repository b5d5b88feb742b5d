//! A line's way through the sums: down the columns of the blocks, and along them.

use core::array;

use crate::{
    Disparity, Params, Region,
    availability::{Segments, uniform_columns},
    disparity::MAX_BATCH,
    kernel::{Block, Blocks, Change, Isa, Lane, Rule, Steps},
    lines::{Frames, Lines},
    selection::{Exact, Selection, Winners},
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

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The sums of each column of the span, view by view.
    pub columns: &'a mut [I::Sums],
    /// The sums of a column of zeros.
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
    pub fn run(self, v: usize, mut steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let Sweep { isa, params, region, columns, zeros, bias, blocks, fused } = self;
        let vectors = blocks.len();
        let mut window = Window { columns, next: 0, size: V * vectors, block: params.block_size() * V * vectors, zeros };
        for costs in blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for _ in 0..2 * params.radius() {
            let Some((column, left)) = window.next() else { return };
            isa.slide(&mut steps, column, left, blocks);
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Segments::new(params, uniform.start, v);
        let complete = of_uniform.are_complete(params);
        let mut winners = Winners { costs: [L::MAX; MAX_BATCH], indices: [0; MAX_BATCH] };
        let batches = out.chunks_mut(const { if I::BATCH < MAX_BATCH { I::BATCH } else { MAX_BATCH } });
        let mut first = region.columns().start;
        for pixels in batches {
            let costs = fused.chunks_exact_mut(vectors.max(1));
            for ((fused, least), u) in costs.zip(&mut winners.costs).zip(first..first + pixels.len()) {
                let Some((column, left)) = window.next() else { return };
                if complete && uniform.contains(&u) {
                    *least = selection.slide_and_fuse(&mut steps, column, left, blocks, fused);
                    continue;
                }
                isa.slide(&mut steps, column, left, blocks);
                *least = match uniform.contains(&u) {
                    true => selection.fuse_segments(&of_uniform, blocks, fused),
                    false => selection.fuse_segments(&Segments::new(params, u, v), blocks, fused),
                };
            }
            let columns = &*window.columns;
            let exact = |u: usize| {
                let columns = columns.get((u - region.columns().start) * V * vectors..).unwrap_or_default();
                Exact { params, u, v, columns, vectors, bias }
            };
            selection.disparities(&mut winners, fused, vectors, pixels, |i| exact(first + i));
            first += pixels.len();
        }
    }
}

/// The columns of the span in their order, each with the one that leaves the block as it enters.
struct Window<'a, S> {
    columns: &'a mut [S],
    /// Where the next column is.
    next: usize,
    /// The sums of a column.
    size: usize,
    /// The sums of a block's columns.
    block: usize,
    /// What leaves where nothing has entered.
    zeros: &'a [S],
}

impl<S> Window<'_, S> {
    /// The next column and the one that leaves.
    #[inline(always)]
    fn next(&mut self) -> Option<(&mut [S], &[S])> {
        let (before, rest) = self.columns.split_at_mut_checked(self.next)?;
        let left = match self.next.checked_sub(self.block) {
            Some(left) => before.get(left..)?,
            None => self.zeros,
        };
        self.next += self.size;
        Some((rest.get_mut(..self.size)?, left.get(..self.size)?))
    }
}
