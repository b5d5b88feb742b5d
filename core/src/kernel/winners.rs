//! Winner-takes-all over a batch: the least fused cost of each pixel.
//!
//! Finding it has a long latency, but no pixel waits for another: an out-of-order processor overlaps several,
//! given nothing else to do in between.
#![allow(unsafe_code)]

use super::{
    blocks::{Blocks, assert_costs},
    isa::MAX_BATCH,
    vector::Lane,
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
