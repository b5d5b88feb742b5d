//! A line's way through the sums: down the columns of the blocks, and along them.

use core::array;

use crate::{
    Disparity, Params, Region,
    availability::{Segments, uniform_columns},
    kernel::{Block, Blocks, Change, Isa, Lane, Rule, Steps},
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

/// The most pixels in a batch.
const MAX_BATCH: usize = 16;

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
    #[inline(always)]
    pub fn run(mut self, v: usize, out: &mut [Option<Disparity>]) {
        let (isa, params, vectors, bias) = (self.isa, self.params, self.blocks.len(), self.bias);
        for costs in self.blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for _ in 0..2 * params.radius() {
            isa.slide(&mut self.steps, self.blocks);
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Segments::new(params, uniform.start, v);
        let (start, end) = (self.region.columns().start, self.region.columns().end);
        let complete = of_uniform.are_complete(params);
        let mut leasts = [L::MAX; MAX_BATCH];
        for (pixels, u) in out.chunks_mut(I::BATCH.min(MAX_BATCH)).zip((start..end).step_by(I::BATCH.min(MAX_BATCH))) {
            for ((least, u), i) in leasts.iter_mut().zip(u..).zip(0..pixels.len()) {
                isa.slide(&mut self.steps, self.blocks);
                let fused = self.fused.get_mut(i * vectors..(i + 1) * vectors).unwrap_or_default();
                *least = match uniform.contains(&u) {
                    true if complete => selection.fuse(self.blocks, fused),
                    true => selection.fuse_segments(&of_uniform, self.blocks, fused),
                    false => selection.fuse_segments(&Segments::new(params, u, v), self.blocks, fused),
                };
            }
            for (((pixel, &least), u), i) in pixels.iter_mut().zip(&leasts).zip(u..).zip(0..) {
                let fused = self.fused.get(i * vectors..(i + 1) * vectors).unwrap_or_default();
                let steps = &self.steps;
                *pixel = selection.disparity(least, fused, || {
                    let columns = steps.sums().get((u - start) * V * vectors..).unwrap_or_default();
                    Exact { params, u, v, columns, vectors, bias }
                });
            }
        }
    }
}
