//! A path along a line in registers, for out-of-order processors.
//!
//! In memory, each step would wait for the stores of the step before: processors do not forward a store to a
//! load that begins a byte earlier or later.

use super::{
    lanes::{ByteVector, Bytes, as_vectors},
    paths,
};

/// A path along a line, up to a pixel, in `M` vectors.
#[derive(Clone, Copy, Debug)]
pub struct Along<I: Bytes, const M: usize> {
    /// The path costs.
    costs: [I::Bytes; M],
    /// The least of them, in each lane.
    least: I::Bytes,
}

impl<I: Bytes, const M: usize> Along<I, M> {
    /// A path that begins: the costs of a [slot](super::Slot) without what is around them.
    #[inline(always)]
    pub fn begin(isa: I, costs: &[u8]) -> Along<I, M> {
        let mut path = Along { costs: [isa.splat_byte(u8::MAX); M], least: isa.splat_byte(0) };
        for (vector, costs) in path.costs.iter_mut().zip(as_vectors::<I>(costs)) {
            *vector = isa.load_bytes(costs);
        }
        path
    }

    /// Goes to the pixel with these `costs`, and returns what the path adds to them: the step of
    /// [`PixelLoops::extend`](super::PixelLoops::extend).
    #[inline(always)]
    pub fn step(&mut self, isa: I, costs: &[I::Samples], p1: u8, p2: u8) -> [I::Bytes; M] {
        let (none, p1) = (isa.splat_byte(u8::MAX), isa.splat_byte(p1));
        let jump = self.least.add(isa.splat_byte(p2));
        let (mut added, mut least, before) = ([none; M], none, self.costs);
        for j in 0..M {
            let Some(cost) = costs.get(j) else { break };
            let lower = before[j].moved_up(if j > 0 { before[j - 1] } else { none });
            let upper = before[j].moved_down(if j + 1 < M { before[j + 1] } else { none });
            added[j] = paths::added([lower, before[j], upper], p1, jump, self.least);
            self.costs[j] = isa.load_bytes(cost).add(added[j]);
            least = least.min(self.costs[j]);
        }
        self.least = least.least_in_each();
        added
    }
}
