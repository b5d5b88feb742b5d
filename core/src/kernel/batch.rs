//! A batch of pixels whose block sums stay in registers, for instruction sets that have enough of them.
//!
//! ```text
//! sums[j][k] = the block of the pixel before the batch     // J vectors of disparities in each of V views
//! for each stretch of columns that the steps give:         // 1 column until blocks are full, then many
//!     for each column i, which is a pixel:
//!         if MASKED: masks[j][k] = the views that hide at this pixel
//!         for j in 0..J, k in 0..V:                        // unrolled
//!             column[j][k] += |center - view|(entering line) - |center - view|(leaving line)
//!             sums[j][k]   += column[j][k] - leaving_column[j][k]
//!             costs[k]      = max(sums[j][k], masks[j][k])
//!         fused[i][j] = rule(costs), in the order of the disparities, max padding in the last vector
//!         if the rule is not Min: kept[i] = sums           // for exact costs, should lanes saturate
//! store sums as the block of the last pixel
//! ```
//!
//! The plain way over a line ([`Blocks::slide_and_fuse`]) loads and stores the block sums at each pixel, which takes as
//! many accesses as the columns do. Here they live in `V x J` registers for a whole batch, and the addresses of a stretch
//! are computed once. That pays for `J` of 1 or 2 vectors: more do not fit the registers.
//!
//! The decisions that hold for a whole batch are constants of the inner function (`J`, `MASKED`, and the rule, which is a
//! constant after inlining), so that the loop over the columns has no branch but its own. Padding has no loop of its own: a
//! maximum with zeros, where there is none, takes no time that `bench` can show.
//!
//! Invariants that the unsafe code relies on:
//! - A stretch has samples and sums for each of its columns: `Steps::new` has checked the whole line.
//! - The entering and the leaving column are different columns, since a block has at least one column.
//! - Vectors of samples are plain bytes ([`assert_layout`](super::isa::assert_layout)), and costs have one lane for each
//!   disparity ([`assert_costs`]).
//!
//! The winners of a batch, the least fused cost of each pixel, are found for all of its pixels together. Finding one has a
//! long latency, but no pixel waits for another: an out-of-order processor overlaps several, given nothing else to do in
//! between.
#![allow(unsafe_code)]

use core::mem;

use super::{
    blocks::{Blocks, Masks, assert_costs},
    isa::{Block, Change, Column, Lane, MAX_BATCH},
    rule::Rule,
    steps::{Steps, Stretch},
};

/// The least fused costs of a batch of pixels, and their neighbours.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Winners<L> {
    /// The first index with the least cost.
    pub indices: [u32; MAX_BATCH],
    /// The least cost.
    pub costs: [L; MAX_BATCH],
    /// The cost at the index before; arbitrary at the first index.
    pub before: [L; MAX_BATCH],
    /// The cost at the index after; arbitrary at the last index.
    pub after: [L; MAX_BATCH],
}

impl<L: Lane> Winners<L> {
    /// No pixels yet.
    pub const NONE: Winners<L> =
        Winners { indices: [0; MAX_BATCH], costs: [L::MAX; MAX_BATCH], before: [L::MAX; MAX_BATCH], after: [L::MAX; MAX_BATCH] };

    /// Finds the winners of a batch: `padded` has the fused costs of its pixels, `vectors` for each, in the
    /// order of the disparities, between two vectors of padding.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn find<I: Blocks<L>>(&mut self, isa: I, padded: &[I::Costs], vectors: usize) {
        // The usual numbers of vectors as constants.
        match vectors {
            1 => self.find_in(isa, padded, 1),
            2 => self.find_in(isa, padded, 2),
            _ => self.find_in(isa, padded, vectors),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn find_in<I: Blocks<L>>(&mut self, isa: I, padded: &[I::Costs], vectors: usize) {
        const { assert_costs::<L, I>() };
        const { assert!(I::BATCH == 1 || I::LANES >= 4, "too few lanes to read past the end") };
        let lanes = padded.as_ptr().cast::<L>();
        let [_, fused @ .., _] = padded else { return };
        let pixels = fused.chunks_exact(vectors.max(1)).take(MAX_BATCH);
        // Two loops instead of one, so that the processor overlaps pixels rather than the stages of one.
        for (fused, cost) in pixels.clone().zip(&mut self.costs) {
            *cost = isa.least(fused);
        }
        for (i, fused) in pixels.enumerate() {
            let index = isa.position(fused, self.costs[i]).min(vectors * I::LANES);
            self.indices[i] = index as u32;
            // SAFETY: the pixel's lanes begin at a vector after the first, and another vector follows them,
            // so there is a lane before `index`. At most three of the four lanes lie in the vector that
            // follows, which has four or more.
            let around = unsafe { lanes.add((1 + i * vectors) * I::LANES + index - 1).cast::<[L; 4]>().read_unaligned() };
            [self.before[i], _, self.after[i], _] = around;
        }
    }
}

/// Neighbouring pixels of a line.
#[derive(Debug)]
pub(crate) struct Batch<'a, 'm, L: Lane, I: Blocks<L>, const V: usize> {
    pub rule: Rule,
    /// The sums of the block of the pixel before, then of the last pixel.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The sums of each pixel's block, kept unless the rule is [`Rule::Min`].
    pub kept: &'a mut [[I::Costs; V]],
    /// The fused costs of each pixel, in the order of the disparities.
    pub fused: &'a mut [I::Costs],
    /// If the last vector of a pixel has lanes past the last disparity: [`Lane::MAX`] in those lanes, and zero
    /// elsewhere, in the order of the disparities.
    pub padding: Option<I::Block>,
    /// The masks, if a view is not available at some pixel, and the column of the first pixel.
    pub masks: Option<(&'a mut Masks<'m, L, I, V>, usize)>,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Batch<'_, '_, L, I, V> {
    /// The most vectors in each view of a batch.
    pub const VECTORS: usize = if I::IN_REGISTERS { 2 } else { 0 };

    /// Slides the block along the pixels and fuses its sums.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn fuse(self, isa: I, steps: &mut Steps<'_, I, V>) {
        if const { Self::VECTORS > 1 } && self.blocks.len() > 1 {
            self.fuse_vectors::<2>(isa, steps);
        } else {
            self.fuse_vectors::<1>(isa, steps);
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fuse_vectors<const J: usize>(self, isa: I, steps: &mut Steps<'_, I, V>) {
        match self.masks {
            Some(_) => self.fuse_hidden::<J, true>(isa, steps),
            None => self.fuse_hidden::<J, false>(isa, steps),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fuse_hidden<const J: usize, const MASKED: bool>(self, isa: I, steps: &mut Steps<'_, I, V>) {
        match self.rule {
            // Masks cannot hide views from a sum.
            Rule::Sum if V > 1 && !MASKED => self.fuse_by_rule::<J, MASKED>(isa, Rule::Sum, steps),
            Rule::Half if Rule::HAS_HALF && V > 2 => self.fuse_by_rule::<J, MASKED>(isa, Rule::Half, steps),
            Rule::Heuristic if V > 2 => self.fuse_by_rule::<J, MASKED>(isa, Rule::Heuristic, steps),
            _ => self.fuse_by_rule::<J, MASKED>(isa, Rule::Min, steps),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fuse_by_rule<const J: usize, const MASKED: bool>(mut self, isa: I, rule: Rule, steps: &mut Steps<'_, I, V>) {
        const { assert_costs::<L, I>() };
        let Some(blocks) = self.blocks.first_chunk_mut::<J>().filter(|_| steps.vectors() == J) else { return };
        let mut sums = [[isa.splat(L::default()); V]; J];
        let mut masks = sums;
        let padding = self.padding.unwrap_or(isa.splat(L::default()));
        load(isa, blocks, &mut sums);
        let (mut fused, mut kept) = (self.fused.as_chunks_mut::<J>().0, self.kept.as_chunks_mut::<J>().0);
        let mut pixel = 0;
        while let Some(Stretch { columns, center, tracks, entering, leaving, .. }) = steps.stretch(fused.len()) {
            let Some((of_columns, rest)) = mem::take(&mut fused).split_at_mut_checked(columns) else { return };
            fused = rest;
            for (i, fused) in of_columns.iter_mut().enumerate() {
                // SAFETY: the stretch has samples of the centre for `columns` columns, and `i` is one of
                // them.
                let center = unsafe { Change { entering: *center.entering.add(i), leaving: *center.leaving.add(i) } };
                if MASKED && let Some((following, u)) = &mut self.masks {
                    following.enter(*u + pixel);
                    if let Some(vectors) = following.vectors.first_chunk() {
                        load(isa, vectors, &mut masks);
                    }
                }
                pixel += 1;
                for (j, fused) in fused.iter_mut().enumerate() {
                    let mut costs = [isa.splat(L::default()); V];
                    each_view!(k, {
                        let vector = (i * V + k) * J + j;
                        let track = tracks[k];
                        let samples = |first: *const u8| {
                            first.wrapping_offset(i as isize * track.step).cast::<I::Samples>().wrapping_add(j)
                        };
                        // SAFETY: each column of the stretch has samples and sums of `V` views in `J`
                        // vectors. Samples are bytes, by `assert_layout`. The leaving column is another one
                        // than the entering column.
                        let (view, column, leaving_column) = unsafe {
                            let view =
                                Change { entering: &*samples(track.samples.entering), leaving: &*samples(track.samples.leaving) };
                            (view, &mut *entering.add(vector), &*leaving.add(vector))
                        };
                        let moved = isa.advance(isa.load_column(column), center, view);
                        moved.store(column);
                        sums[j][k] = sums[j][k].slide(moved, isa.load_column(leaving_column));
                        costs[k] = sums[j][k];
                        if MASKED {
                            costs[k] = costs[k].max(masks[j][k]);
                        }
                    });
                    let costs = if MASKED { rule.fuse_masked(costs, isa.splat(L::MAX)) } else { rule.fuse(costs) };
                    let costs = costs.ordered();
                    // Masks hide the padding as well.
                    let costs = if !MASKED && j + 1 == J { costs.max(padding) } else { costs };
                    costs.store(fused);
                }
                if rule != Rule::Min
                    && let Some((first, rest)) = mem::take(&mut kept).split_first_mut()
                {
                    store(sums, first);
                    kept = rest;
                }
            }
        }
        store(sums, blocks);
    }
}

/// Loads costs. A loop, since a closure would not be compiled for the instruction set.
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

/// Stores block sums.
#[inline(always)]
fn store<L: Lane, B: Block<L>, const V: usize, const J: usize>(sums: [[B; V]; J], blocks: &mut [[B::Costs; V]; J]) {
    for (blocks, sums) in blocks.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
        sums.store(blocks);
    }
}
