//! A line's way through the sums: down the columns of the blocks, and along them.

use core::{array, mem};

use crate::{
    Disparity, Params, Region,
    availability::{Availability, uniform_columns},
    kernel::{Batch, Block, Blocks, Change, Isa, Lane, Rule, Steps, Winners},
    lines::{Frames, Lines},
    selection::{Exact, Selection},
};

/// The way along the two lines of the centre, which may be virtual.
#[inline(always)]
pub(crate) fn steps<'a, I: Isa, const V: usize>(
    frames: &'a Frames<'_>,
    lines: Change<i32>,
    sums: &'a mut [I::Sums],
    nothing: &'a [I::Sums],
    block_size: usize,
) -> Steps<'a, I, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    let views = array::from_fn(|_| at(views.next().unwrap_or(&frames.center)));
    Steps::new(at(&frames.center), views, sums, nothing, block_size)
}

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The way along the columns.
    pub steps: Steps<'a, I, V>,
    /// What every column sum has too much.
    pub bias: u16,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The fused costs of a batch of pixels.
    pub fused: &'a mut [I::Costs],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Moves the blocks down by a step and along line `v`, and writes its disparities.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn run(self, v: usize, out: &mut [Option<Disparity>]) {
        let Sweep { isa, params, region, mut steps, bias, blocks, fused } = self;
        let vectors = blocks.len();
        for costs in blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for _ in 0..2 * params.radius() {
            isa.slide(&mut steps, blocks);
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Availability::new(params, uniform.start, v);
        let complete = of_uniform.is_complete();
        let mut winners = Winners::new();
        let start = region.columns().start;
        let (mut u, mut out) = (region.columns().start, out);
        while !out.is_empty() {
            let inside = uniform.contains(&u);
            // Pixels whose views are all available come in batches, all others one by one.
            let batch = if I::BATCH > 1 && complete && inside {
                I::BATCH.min(Winners::<L>::MAX).min(uniform.end - u).min(out.len())
            } else {
                1
            };
            let Some((pixels, others)) = mem::take(&mut out).split_at_mut_checked(batch) else { return };
            if batch > 1 {
                let excess = selection.excess();
                let batch = Batch { rule: selection.rule, pixels: batch, blocks, fused, excess };
                isa.batch(batch, &mut steps, &mut winners);
                selection.disparities(&winners, pixels, |i| Exact {
                    params,
                    u: u + i,
                    v,
                    start,
                    sums: steps.sums(),
                    vectors,
                    bias,
                });
            } else if let [pixel] = pixels {
                isa.slide(&mut steps, blocks);
                let fused = fused.get_mut(..vectors).unwrap_or_default();
                let least = match inside {
                    true if complete => selection.fuse(blocks, fused),
                    true => selection.fuse_segments(&of_uniform, blocks, fused),
                    false => selection.fuse_segments(&of_uniform.clone().in_column(u), blocks, fused),
                };
                *pixel = selection.disparity(least, fused, || Exact { params, u, v, start, sums: steps.sums(), vectors, bias });
            }
            u += batch;
            out = others;
        }
    }
}
