//! A batch of pixels with all sums of their blocks in registers, for instruction sets that have enough of them.
#![allow(unsafe_code)]

use core::mem;

use super::{Batch, Block, Blocks, Change, Column, Lane, Rule, Steps, fuse, steps::Stretch};

impl<L: Lane, I: Blocks<L>, const V: usize> Batch<'_, L, I, V> {
    /// As [`run`](Batch::run), with all sums of the block in registers, if there are few enough.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn run_in_registers(self, isa: I, steps: &mut Steps<'_, I, V>) {
        match self.blocks.len() {
            1 => self.run_by_rule::<1>(isa, steps),
            2 => self.run_by_rule::<2>(isa, steps),
            _ => self.run(isa, steps),
        }
    }

    /// As [`run`](Batch::run), in `J` vectors.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run_by_rule<const J: usize>(self, isa: I, steps: &mut Steps<'_, I, V>) {
        match (self.rule, self.masks.is_some()) {
            (Rule::Sum, _) if V > 1 => self.fuse_in_registers::<J, false>(isa, Rule::Sum, steps),
            (Rule::Heuristic, false) if V > 2 => self.fuse_in_registers::<J, false>(isa, Rule::Heuristic, steps),
            (Rule::Heuristic, true) if V > 2 => self.fuse_in_registers::<J, true>(isa, Rule::Heuristic, steps),
            (_, false) => self.fuse_in_registers::<J, false>(isa, Rule::Min, steps),
            (_, true) => self.fuse_in_registers::<J, true>(isa, Rule::Min, steps),
        }
    }

    /// As [`run`](Batch::run), in `J` vectors.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fuse_in_registers<const J: usize, const MASKED: bool>(mut self, isa: I, rule: Rule, steps: &mut Steps<'_, I, V>) {
        let Some(blocks) = self.blocks.first_chunk_mut::<J>().filter(|_| steps.vectors() == J) else { return };
        let mut sums = [[isa.splat(L::default()); V]; J];
        let mut masks = sums;
        load(isa, blocks, &mut sums);
        let (mut fused, mut each) = (self.fused.as_chunks_mut::<J>().0, self.each.as_chunks_mut::<J>().0);
        let mut pixel = 0;
        while let Some(Stretch { columns, center, tracks, column, left, .. }) = steps.stretch(fused.len()) {
            let Some((of_columns, others)) = mem::take(&mut fused).split_at_mut_checked(columns) else { return };
            fused = others;
            for (i, fused) in of_columns.iter_mut().enumerate() {
                // SAFETY: so many samples of the centre follow.
                let center = unsafe { Change { entering: *center.entering.add(i), leaving: *center.leaving.add(i) } };
                if MASKED
                    && let Some(of_line) = &mut self.masks
                    && let Some(lanes) = of_line.of_pixel(isa, pixel).first_chunk()
                {
                    load(isa, lanes, &mut masks);
                }
                pixel += 1;
                for (j, fused) in fused.iter_mut().enumerate() {
                    let mut costs = [isa.splat(L::default()); V];
                    for k in 0..V {
                        let sum = (i * V + k) * J + j;
                        let samples =
                            |samples: *const u8| samples.wrapping_offset(i as isize * tracks[k].step).cast::<I::Samples>();
                        let Change { entering, leaving } = tracks[k].samples;
                        // SAFETY: at each of the columns are the samples and the sums of `V` views in `J` vectors. Samples are bytes. The column that is
                        // left is another.
                        let (view, column, left) = unsafe {
                            let view = Change { entering: &*samples(entering).add(j), leaving: &*samples(leaving).add(j) };
                            (view, &mut *column.add(sum), &*left.add(sum))
                        };
                        let moved = isa.advance(isa.load_column(column), center, view);
                        moved.store(column);
                        sums[j][k] = sums[j][k].slide(moved, isa.load_column(left));
                        costs[k] = sums[j][k];
                        if MASKED {
                            costs[k] = costs[k].max(masks[j][k]);
                        }
                    }
                    fuse(rule, costs).ordered().store(fused);
                }
                if rule != Rule::Min
                    && let Some((first, others)) = mem::take(&mut each).split_first_mut()
                {
                    store(sums, first);
                    each = others;
                }
            }
        }
        store(sums, blocks);
    }
}

/// Takes costs from memory. A loop instead of closures, which would not be compiled for the instruction set.
#[inline(always)]
fn load<L: Lane, I: Blocks<L>, const V: usize, const J: usize>(
    isa: I,
    from: &[[I::Costs; V]; J],
    costs: &mut [[I::Block; V]; J],
) {
    for (costs, from) in costs.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *costs = isa.load_block(from);
    }
}

/// Puts the sums of a block into memory.
#[inline(always)]
fn store<L: Lane, B: Block<L>, const V: usize, const J: usize>(sums: [[B; V]; J], blocks: &mut [[B::Costs; V]; J]) {
    for (blocks, sums) in blocks.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
        sums.store(blocks);
    }
}
