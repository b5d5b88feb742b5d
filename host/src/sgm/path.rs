//! The recursion along a path.

use super::vector::{LANES, Vector, Vectors};

/// The costs of paths up to pixels side by side: those of a pixel at each disparity, with a cost that none exceeds between pixels.
#[derive(Clone, Debug)]
pub(super) struct PathCosts {
    lanes: usize,
    costs: Vec<u16>,
    /// The least of each pixel.
    least: Vec<u16>,
}

impl PathCosts {
    /// Those of paths that have not begun: 0.
    pub fn new(width: usize, lanes: usize) -> PathCosts {
        let mut costs = vec![0; width * (lanes + 1) + 1];
        costs.iter_mut().step_by(lanes + 1).for_each(|between| *between = u16::MAX);
        PathCosts { lanes, costs, least: vec![0; width] }
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        self.costs.chunks_exact_mut(self.lanes + 1).for_each(|pixel| pixel[1..].fill(0));
        self.least.fill(0);
    }

    /// The costs of the path up to pixel `u`.
    #[inline(always)]
    pub fn at(&self, u: usize) -> Path<'_> {
        Path { costs: &self.costs[u * (self.lanes + 1)..][..self.lanes + 2], least: self.least[u] }
    }

    /// Makes pixel `u` the one after `before` on its path, adds its costs to `sums`, and keeps them.
    ///
    /// The cost of the path at `d` is that of the pixel, and the least of: the path before at `d`; at `d - 1` or `d + 1`, and `p1`; at any
    /// disparity, and `p2`; less the least of the path before, so that it stays small. What does not exist stays `u16::MAX`; where
    /// nothing exists the path begins anew.
    #[inline(always)]
    pub fn extend<I: Vectors>(
        &mut self,
        isa: I,
        u: usize,
        before: Path<'_>,
        costs: &[u16],
        [p1, p2]: [u16; 2],
        sums: &mut [u16],
    ) {
        let (jump, p1, least_before) = (isa.splat(before.least.saturating_add(p2)), isa.splat(p1), isa.splat(before.least));
        let mut least = isa.splat(u16::MAX);
        let after = &mut self.costs[u * (self.lanes + 1) + 1..][..self.lanes];
        let afters = after.as_chunks_mut().0.iter_mut().zip(sums.as_chunks_mut().0);
        let befores = before.costs.windows(LANES + 2).step_by(LANES);
        for ((before, costs), (after, sums)) in befores.zip(costs.as_chunks().0).zip(afters) {
            let load = |i: usize| isa.load(before[i..].first_chunk().expect("two more than lanes"));
            let (nearer, same, further) = (load(0), load(1), load(2));
            let step = nearer.min(further).add(p1);
            let cost = isa.load(costs).add(same.min(step).min(jump).sub(least_before));
            cost.store(after);
            isa.load(sums).add(cost).store(sums);
            least = least.min(cost);
        }
        self.least[u] = least.least();
    }
}

/// The costs of a path up to a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path<'a> {
    /// At each disparity, one more on either side.
    costs: &'a [u16],
    least: u16,
}
