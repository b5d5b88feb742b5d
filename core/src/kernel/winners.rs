//! The least of the fused costs of each pixel of a batch.
//!
//! It is known long after them, but no other pixel waits for it: an out-of-order processor looks for those of several at once, if nothing
//! else is in its way.
#![allow(unsafe_code)]

use super::{Blocks, Lane};

/// The least fused costs of a batch of pixels, and those around them.
#[derive(Clone, Copy, Debug)]
pub struct Winners<L> {
    /// The first indices of the least costs.
    pub indices: [u32; MAX],
    /// The least costs.
    pub costs: [L; MAX],
    /// The costs at the index before: those before the first mean nothing.
    pub before: [L; MAX],
    /// The costs at the index after: those after the last mean nothing.
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
    pub const NONE: Winners<L> = Winners { indices: [0; MAX], costs: [L::MAX; MAX], before: [L::MAX; MAX], after: [L::MAX; MAX] };

    /// Finds them in the fused costs of pixels, `vectors` for each, in the order of the disparities, between two vectors that mean nothing.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn find<I: Blocks<L>>(&mut self, isa: I, padded: &[I::Costs], vectors: usize) {
        match vectors {
            1 => self.find_in(isa, padded, 1),
            2 => self.find_in(isa, padded, 2),
            _ => self.find_in(isa, padded, vectors),
        }
    }

    /// As [`find`](Winners::find).
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn find_in<I: Blocks<L>>(&mut self, isa: I, padded: &[I::Costs], vectors: usize) {
        const { assert!(I::BATCH == 1 || I::LANES >= 4, "too few lanes to read past the end") };
        let lanes = padded.as_ptr().cast::<L>();
        let [_, fused @ .., _] = padded else { return };
        let pixels = fused.chunks_exact(vectors.max(1)).take(MAX);
        // Two loops instead of one: what a processor looks at ahead are then several pixels, and not all that one waits for.
        for (fused, cost) in pixels.clone().zip(&mut self.costs) {
            *cost = isa.least(fused);
        }
        for (i, fused) in pixels.enumerate() {
            let index = isa.position(fused, self.costs[i]).min(vectors * I::LANES);
            self.indices[i] = index as u32;
            // SAFETY: behind a vector, the lanes of each pixel follow each other, and past them there is another vector. Of that, at most three lanes
            // are read.
            let around = unsafe { lanes.add((1 + i * vectors) * I::LANES + index - 1).cast::<[L; 4]>().read_unaligned() };
            [self.before[i], _, self.after[i], _] = around;
        }
    }
}
