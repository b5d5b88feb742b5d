//! From the block sums of a pixel to its disparity.

use crate::{
    Disparity, Params,
    availability::Segments,
    kernel::{self, Block, Blocks, Isa, Lane, Rule},
};

/// The choice of a disparity by fused costs in lanes.
///
/// A lane that holds [`Lane::MAX`] has saturated, or belongs to no candidate.
pub(crate) struct Selection<'a, L, I: Blocks<L>> {
    isa: I,
    params: &'a Params,
    rule: Rule,
    /// The index of each lane of a vector.
    indices: I::Costs,
    /// Zero in the lanes of the last vector that belong to a disparity, and the greatest cost in those that are too many.
    excess: I::Costs,
}

/// The least fused cost in lanes, and its first index.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Winner<L> {
    index: u16,
    cost: L,
}

impl<'a, L: Lane, I: Blocks<L>> Selection<'a, L, I> {
    pub fn new(isa: I, params: &'a Params, rule: Rule) -> Selection<'a, L, I> {
        let mut indices = <I::Costs as bytemuck::Zeroable>::zeroed();
        let mut excess = indices;
        for index in 0..I::LANES {
            if let Some(lane) = lanes_mut::<L, _>(&mut indices).get_mut(I::lane(index)) {
                *lane = L::from_index(index);
            }
            let is_excess = index > (params.num_disparities() - 1) % I::LANES;
            if let Some(lane) = lanes_mut::<L, _>(&mut excess).get_mut(I::lane(index)).filter(|_| is_excess) {
                *lane = L::MAX;
            }
        }
        Selection { isa, params, rule, indices, excess }
    }

    /// Fuses the costs of a pixel whose views are all available at all disparities.
    #[inline(always)]
    pub fn fuse<const V: usize>(&self, blocks: &[[I::Costs; V]], fused: &mut [I::Costs]) {
        for (fused, block) in fused.iter_mut().zip(blocks) {
            let mut costs = [self.isa.splat(L::default()); V];
            for k in 0..V {
                costs[k] = self.isa.load_block(&block[k]);
            }
            kernel::fuse(self.rule, costs).store(fused);
        }
        if let Some(last) = fused.last_mut() {
            self.isa.load_block(last).max(self.isa.load_block(&self.excess)).store(last);
        }
    }

    /// Fuses the costs of a pixel segment by segment.
    #[inline(always)]
    pub fn fuse_segments<const V: usize>(&self, segments: &Segments, blocks: &[[I::Costs; V]], fused: &mut [I::Costs]) {
                for segment in segments.iter() {
            // Each segment is followed by the next, so that lanes past its end do not matter; of its first vector the lanes before its start are
            // kept.
            let first = segment.start / I::LANES;
            let vectors = fused.iter_mut().zip(blocks).skip(first).take(segment.end.div_ceil(I::LANES) - first);
            let mut kept = self.isa.splat(L::from_index(segment.start - first * I::LANES));
            for (fused, block) in vectors {
                let costs = match segment.views {
                    0 => self.isa.splat(L::MAX),
                    views => kernel::fuse_available(self.isa, self.rule, views, block),
                };
                let before = self.isa.load_block(fused);
                kept.if_greater(self.isa.load_block(&self.indices), before, costs).store(fused);
                kept = self.isa.splat(L::default());
            }
        }
        if let Some(last) = fused.last_mut() {
            self.isa.load_block(last).max(self.isa.load_block(&self.excess)).store(last);
        }
    }

    /// The least of a pixel's fused costs.
    #[inline(always)]
    pub fn winner(&self, fused: &[I::Costs]) -> Winner<L> {
        let mut least = self.isa.splat(L::MAX);
        for costs in fused {
            least = least.min(self.isa.load_block(costs));
        }
        let cost = least.least();
        Winner { index: self.isa.position(fused, cost) as u16, cost }
    }

    /// The disparity of a pixel's winner, refined between its neighbours; that by `exact` costs, where lanes do not tell.
    #[inline(always)]
    pub fn disparity<'e>(&self, winner: Winner<L>, fused: &[I::Costs], exact: impl FnOnce() -> Exact<'e, I>) -> Option<Disparity> {
        let index = usize::from(winner.index);
        if winner.cost == L::MAX {
            return exact().disparity();
        }
        let d = self.params.min_disparity() + winner.index as i16;
        if index == 0 || index + 1 >= self.params.num_disparities() {
            return Disparity::whole(d);
        }
        let lanes: &[L] = bytemuck::try_cast_slice(fused).unwrap_or_default();
        match (lanes.get(lane::<I>(index - 1)), lanes.get(lane::<I>(index + 1))) {
            (Some(&before), Some(&after)) if before != L::MAX && after != L::MAX => {
                Disparity::refine(d, before.widen(), winner.cost.widen(), after.widen())
            }
            _ => exact().refined(index),
        }
    }
}

/// Where the lane of a disparity is among those of a pixel.
#[inline(always)]
fn lane<I: Isa>(index: usize) -> usize {
    index / I::LANES * I::LANES + I::lane(index % I::LANES)
}

/// A vector's lanes.
fn lanes_mut<L: Lane, T: bytemuck::Pod>(vector: &mut T) -> &mut [L] {
    bytemuck::try_cast_slice_mut(core::slice::from_mut(vector)).unwrap_or_default()
}

/// The exact fused costs of a pixel, one by one: for where lanes have saturated, and next to disparities at which no view is available.
pub(crate) struct Exact<'a, I: Isa> {
    pub params: &'a Params,
    /// The pixel.
    pub u: usize,
    pub v: usize,
    /// The sums of the columns under its block, view by view.
    pub columns: &'a [I::Sums],
    /// Vectors in a column's view.
    pub vectors: usize,
}

impl<I: Isa> Exact<'_, I> {
    /// The existing candidate of least fused cost, the smallest of several, refined between its neighbours.
    #[cold]
    pub fn disparity(&self) -> Option<Disparity> {
        let segments = Segments::new(self.params, self.u, self.v);
        let all = 0..self.params.num_disparities();
        let costs = all.filter_map(|index| Some((self.cost(&segments, index)?, index)));
        let (_, index) = costs.min_by_key(|&(cost, _)| cost)?;
        self.refined(index)
    }

    /// The disparity at `index`, refined if both neighbours exist.
    #[cold]
    pub fn refined(&self, index: usize) -> Option<Disparity> {
        let segments = Segments::new(self.params, self.u, self.v);
        let cost = |index| self.cost(&segments, index);
        let d = self.params.min_disparity() + index as i16;
        match (cost(index.wrapping_sub(1)), cost(index), cost(index + 1)) {
            (Some(before), Some(at), Some(after)) => Disparity::refine(d, before, at, after),
            _ => Disparity::whole(d),
        }
    }

    /// The fused cost of a candidate, if it exists.
    fn cost(&self, segments: &Segments, index: usize) -> Option<u32> {
        let available = segments.views_at(index);
        let mut costs = [0; 4];
        let mut count = 0;
        for k in (0..self.params.views().len()).filter(|k| available >> k & 1 != 0) {
            *costs.get_mut(count)? = self.block_sum(k, index)?;
            count += 1;
        }
        self.params.fusion().fuse(costs.get_mut(..count)?)
    }

    /// The block's sum in the `k`-th view.
    fn block_sum(&self, k: usize, index: usize) -> Option<u32> {
        let columns = self.columns.chunks_exact((self.params.views().len() * self.vectors).max(1));
        columns.take(self.params.block_size()).try_fold(0, |sum, column| {
            let sums: &[u16] = bytemuck::try_cast_slice(column.get(k * self.vectors..)?).ok()?;
            Some(sum + u32::from(*sums.get(lane::<I>(index))?))
        })
    }
}
