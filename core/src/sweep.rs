//! A line's way through the sums: down the columns of the blocks, and along them.

use core::array;

use crate::{
    Disparity, Params, Region,
    availability::{Segments, uniform_columns},
    kernel::{self, Block, Blocks, Change, Isa, Lane, Rule, Step},
    lines::{Frames, Lines, Samples},
    selection::Selection,
};

/// The samples that enter and leave the blocks, of the centre and of `V` views, from column to column.
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

    /// The next column's.
    #[inline(always)]
    fn next<I: Isa>(&mut self) -> Option<Step<'a, I, V>> {
        let center = Change { entering: *self.center.entering.next()?.first()?, leaving: *self.center.leaving.next()?.first()? };
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (view, samples) in views.iter_mut().zip(&mut self.views) {
            *view = Change { entering: samples.entering.next()?, leaving: samples.leaving.next()? };
        }
        Some(Step { center, views })
    }
}

/// Adds the entering line to the sums of all columns, of `vectors` vectors each.
#[inline(always)]
pub(crate) fn prime<I: Isa, const V: usize>(isa: I, columns: &mut [[I::Sums; V]], vectors: usize, mut steps: Steps<'_, V>) {
    for column in columns.chunks_exact_mut(vectors.max(1)) {
        let Some(step) = steps.next::<I>().filter(|step| step.covers(vectors)) else { return };
        for (j, sums) in column.iter_mut().enumerate() {
            kernel::prime(isa, sums, &step, j);
        }
    }
}

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The sums of each column of the span.
    pub columns: &'a mut [[I::Sums; V]],
    /// As many zeros as the sums of a column.
    pub zeros: &'a [[I::Sums; V]],
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The fused costs of a pixel.
    pub fused: &'a mut [I::Costs],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Moves the blocks down by a step and along line `v`, and writes its disparities.
    #[inline(always)]
    pub fn run(self, v: usize, mut steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let Sweep { isa, params, region, columns, zeros, blocks, fused } = self;
        let vectors = blocks.len();

        // The first block's columns but the last.
        for costs in blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        for i in 0..2 * params.radius() {
            let Some(step) = steps.next().filter(|step| step.covers(vectors)) else { return };
            let column = columns.get_mut(i * vectors..).unwrap_or_default();
            for (j, ((column, nothing), block)) in column.iter_mut().zip(zeros).zip(&mut *blocks).enumerate() {
                kernel::advance(isa, column, nothing, block, &step, j);
            }
        }

        // Where all views are available at all disparities, costs are fused as they arise. Only the last vector has lanes too many.
        let uniform = uniform_columns(params);
        let segments = Segments::new(params, uniform.start, v);
        let complete = if segments.are_complete(params) { uniform.clone() } else { 0..0 };
        let rule = Rule::new(params.fusion(), V);
        let excess = excess(isa, params.num_disparities());
        for (x, (u, pixel)) in region.columns().zip(out).enumerate() {
            let Some(step) = steps.next().filter(|step| step.covers(vectors)) else { return };
            // The column that the block's right border reaches, and the one that its left border has left.
            let (before, column) = columns.split_at_mut_checked((x + 2 * params.radius()) * vectors).unwrap_or_default();
            let left = match x.checked_sub(1) {
                Some(x) => before.get(x * vectors..).unwrap_or_default(),
                None => zeros,
            };
            let fuses = complete.contains(&u);
            let mut least = isa.splat(L::MAX);
            let sums = column.iter_mut().zip(left).zip(&mut *blocks).zip(&mut *fused);
            for (j, (((column, left), block), fused)) in sums.enumerate() {
                let costs = kernel::advance(isa, column, left, block, &step, j);
                if let Some(costs) = kernel::fuse(rule, &costs).filter(|_| fuses) {
                    let costs = if j + 1 == vectors { costs.max(excess) } else { costs };
                    costs.store(fused);
                    least = least.min(costs);
                }
            }
            let selection = Selection { isa, params, segments: &segments, blocks };
            let found = if fuses { selection.disparity_of_fused(rule, fused, least) } else { None };
            *pixel = match found {
                Some(found) => found,
                None => {
                    let segments = if uniform.contains(&u) { segments } else { Segments::new(params, u, v) };
                    Selection { isa, params, segments: &segments, blocks }.disparity(fused)
                }
            };
        }
    }
}

/// Zero in the lanes of the last vector that belong to a disparity, and the greatest cost in those that are too many.
#[inline(always)]
fn excess<L: Lane, I: Blocks<L>>(isa: I, num_disparities: usize) -> I::Block {
    let mut costs = <I::Costs as bytemuck::Zeroable>::zeroed();
    let lanes: &mut [L] = bytemuck::try_cast_slice_mut(core::slice::from_mut(&mut costs)).unwrap_or_default();
    for lane in lanes.iter_mut().skip((num_disparities - 1) % I::LANES + 1) {
        *lane = L::MAX;
    }
    isa.load_block(&costs)
}
