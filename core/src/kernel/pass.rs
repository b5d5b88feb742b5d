//! The pass over a pixel's vectors in which its costs stay in registers, for instruction sets that have enough of these.
#![allow(unsafe_code)]

use super::{Block, Blocks, Change, Column, Lane, Rule, Steps, fuse};

/// [`Blocks::slide_and_fuse`], vector by vector.
#[inline(always)]
pub(super) fn slide_and_fuse<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    rule: Rule,
    steps: &mut Steps<'_, V>,
    column: &mut [I::Sums],
    left: &[I::Sums],
    blocks: &mut [[I::Costs; V]],
    fused: &mut [I::Costs],
) -> I::Block {
    let mut least = isa.splat(L::MAX);
    let vectors = blocks.len();
    let Some(step) = steps.next::<I>() else { return least };
    let covers = |samples: &[I::Samples]| samples.len() == vectors;
    let covered = step.views.iter().all(|view| covers(view.entering) && covers(view.leaving));
    if !covered || column.len() != V * vectors || left.len() != V * vectors || fused.len() != vectors {
        return least;
    }
    for (j, (block, fused)) in blocks.iter_mut().zip(fused).enumerate() {
        let mut costs = [least; V];
        for k in 0..V {
            // SAFETY: `j` is below the number of vectors, which all these slices have, the columns for each of the `V` views.
            let (sums, left, entering, leaving) = unsafe {
                (
                    column.get_unchecked_mut(k * vectors + j),
                    left.get_unchecked(k * vectors + j),
                    step.views[k].entering.get_unchecked(j),
                    step.views[k].leaving.get_unchecked(j),
                )
            };
            let moved = isa.advance(isa.load_column(sums), step.center, Change { entering, leaving });
            moved.store(sums);
            costs[k] = isa.load_block(&block[k]).slide(moved, isa.load_column(left));
            costs[k].store(&mut block[k]);
        }
        let costs = fuse(rule, costs);
        costs.store(fused);
        least = least.min(costs);
    }
    least
}
