//! A batch of pixels whose views are all available: along the sums first, then to the least of their costs.
//!
//! The least of a pixel's costs is known long after them, but no other pixel waits for it: an out-of-order processor looks for
//! those of several at once, if nothing else is in its way.
#![allow(unsafe_code)]

use super::{Block, Blocks, Lane, Rule, Steps, lane};
#[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
use super::{Change, Column, fuse, steps::Place};

/// A batch of pixels and their sums.
#[derive(Debug)]
pub struct Batch<'a, L: Lane, I: Blocks<L>, const V: usize> {
    /// How the views' costs become one.
    pub rule: Rule,
    /// How many pixels there are, at most [`Winners::MAX`].
    pub pixels: usize,
    /// The sums of the block before the batch, and after it.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The fused costs of each pixel.
    pub fused: &'a mut [I::Costs],
    /// What the costs in the last vector are at least, if it has lanes too many.
    pub excess: Option<I::Costs>,
}

/// The least fused costs of a batch of pixels, in lanes, and their first indices.
#[derive(Clone, Copy, Debug)]
pub struct Winners<L> {
    /// The least costs.
    pub costs: [L; MAX],
    /// Their indices.
    pub indices: [u32; MAX],
    /// The costs at the indices before, if there are such.
    pub before: [L; MAX],
    /// The costs at the indices after, if there are such.
    pub after: [L; MAX],
}

/// The most pixels in a batch.
const MAX: usize = 32;

impl<L> Winners<L> {
    /// The most pixels in a batch.
    pub const MAX: usize = MAX;
}

impl<L: Lane> Winners<L> {
    /// None yet.
    pub const fn new() -> Winners<L> {
        Winners { costs: [L::MAX; MAX], indices: [0; MAX], before: [L::MAX; MAX], after: [L::MAX; MAX] }
    }
}

impl<L: Lane, I: Blocks<L>, const V: usize> Batch<'_, L, I, V> {
    /// Goes over the pixels one after the other.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn run(mut self, isa: I, steps: &mut Steps<'_, I, V>, winners: &mut Winners<L>) {
        let vectors = self.blocks.len();
        for fused in self.fused.chunks_exact_mut(vectors.max(1)).take(self.pixels) {
            isa.slide(steps, self.blocks);
            isa.fuse(self.rule, self.blocks, fused);
        }
        self.find(isa, vectors, winners);
    }

    /// Finds the least costs.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn find(&mut self, isa: I, vectors: usize, winners: &mut Winners<L>) {
        let Winners { costs, indices, before, after } = winners;
        // Three loops instead of one: what a processor looks at ahead are then several pixels, and not all that one waits for.
        for (fused, cost) in self.fused.chunks_exact_mut(vectors.max(1)).take(self.pixels).zip(&mut *costs) {
            if let (Some(excess), Some(last)) = (&self.excess, fused.last_mut()) {
                isa.load_block(last).max(isa.load_block(excess)).store(last);
            }
            *cost = isa.least(fused);
        }
        let pixels = self.fused.chunks_exact(vectors.max(1)).take(self.pixels);
        for ((fused, &mut cost), index) in pixels.clone().zip(costs).zip(&mut *indices) {
            *index = isa.position(fused, cost) as u32;
        }
        for ((fused, &mut index), (before, after)) in pixels.zip(indices).zip(before.iter_mut().zip(after)) {
            let lanes: &[L] = bytemuck::try_cast_slice(fused).unwrap_or_default();
            let cost = |index: usize| lanes.get(lane::<I>(index)).copied().unwrap_or(L::MAX);
            (*before, *after) = (cost((index as usize).wrapping_sub(1)), cost(index as usize + 1));
        }
    }
}

#[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
impl<L: Lane, I: Blocks<L>, const V: usize> Batch<'_, L, I, V> {
    /// As [`run`](Batch::run), with all sums of the block in registers, if there are few enough.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn run_in_registers(mut self, isa: I, steps: &mut Steps<'_, I, V>, winners: &mut Winners<L>) {
        match (self.blocks.len(), self.rule) {
            (1, Rule::Min) => self.fuse_in_registers::<1>(isa, Rule::Min, steps),
            (1, Rule::Sum) if V > 1 => self.fuse_in_registers::<1>(isa, Rule::Sum, steps),
            (1, Rule::Heuristic) if V > 2 => self.fuse_in_registers::<1>(isa, Rule::Heuristic, steps),
            (2, Rule::Min) => self.fuse_in_registers::<2>(isa, Rule::Min, steps),
            (2, Rule::Sum) if V > 1 => self.fuse_in_registers::<2>(isa, Rule::Sum, steps),
            (2, Rule::Heuristic) if V > 2 => self.fuse_in_registers::<2>(isa, Rule::Heuristic, steps),
            _ => return self.run(isa, steps, winners),
        }
        match self.blocks.len() {
            1 => self.find(isa, 1, winners),
            _ => self.find(isa, 2, winners),
        }
    }

    /// Fuses the costs of the pixels in `J` vectors.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fuse_in_registers<const J: usize>(&mut self, isa: I, rule: Rule, steps: &mut Steps<'_, I, V>) {
        let Some(blocks) = self.blocks.first_chunk_mut::<J>() else { return };
        if self.fused.len() < self.pixels * J || steps.vectors() != J {
            return;
        }
        let mut sums = [[isa.splat(L::default()); V]; J];
        for j in 0..J {
            for k in 0..V {
                sums[j][k] = isa.load_block(&blocks[j][k]);
            }
        }
        for fused in self.fused.chunks_exact_mut(J).take(self.pixels) {
            let Some(Place { center, tracks, column, left, .. }) = steps.enter() else { return };
            for (j, fused) in fused.iter_mut().enumerate() {
                let mut costs = [isa.splat(L::default()); V];
                for k in 0..V {
                    // SAFETY: at the place are the samples and the sums of `V` views in `J` vectors. Samples are bytes.
                    let (column, left, view) = unsafe {
                        let samples = |samples: *const u8| &*samples.cast::<I::Samples>().add(j);
                        let Change { entering, leaving } = (*tracks.add(k)).samples;
                        let view = Change { entering: samples(entering), leaving: samples(leaving) };
                        (&mut *column.add(k * J + j), &*left.add(k * J + j), view)
                    };
                    let moved = isa.advance(isa.load_column(column), center, view);
                    moved.store(column);
                    sums[j][k] = sums[j][k].slide(moved, isa.load_column(left));
                    costs[k] = sums[j][k];
                }
                fuse(rule, costs).store(fused);
            }
            steps.leave();
        }
        for j in 0..J {
            for k in 0..V {
                sums[j][k].store(&mut blocks[j][k]);
            }
        }
    }
}
