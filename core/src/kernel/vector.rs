//! Vectors: their lanes, and the operations on them.

use bytemuck::Pod;

/// The integer in a lane of block sums and costs: 16 bits where the largest block sum fits below
/// [`Lane::MAX`], 32 bits otherwise.
pub trait Lane: Copy + Ord + Default + Pod {
    /// The cost at which 16-bit lanes saturate, and the cost of a candidate that is not available. No cost of
    /// a single view reaches it.
    const MAX: Self;
    /// True if a candidate may have this fused cost. Not in lanes that have saturated or belong to no candidate: masked 32-bit
    /// lanes wrap to values a little below [`Lane::MAX`] when they are fused.
    fn is_cost(self) -> bool;
    /// The cost in 32 bits.
    fn widen(self) -> u32;
    /// The index of a lane as a cost.
    fn from_index(index: usize) -> Self;
}

impl Lane for u16 {
    const MAX: u16 = u16::MAX;

    #[inline(always)]
    fn is_cost(self) -> bool {
        self != u16::MAX
    }

    #[inline(always)]
    fn widen(self) -> u32 {
        self.into()
    }

    #[inline(always)]
    fn from_index(index: usize) -> u16 {
        index as u16
    }
}

impl Lane for u32 {
    const MAX: u32 = u32::MAX;

    #[inline(always)]
    fn is_cost(self) -> bool {
        self < 1 << 31
    }

    #[inline(always)]
    fn widen(self) -> u32 {
        self
    }

    #[inline(always)]
    fn from_index(index: usize) -> u32 {
        index as u32
    }
}

/// A vector of column sums in 16-bit lanes: sums of absolute differences down a column of the block, each at
/// most 21 x 255.
pub trait Column: Copy {
    /// The vector in memory.
    type Sums: Pod;

    /// Stores the sums.
    fn store(self, sums: &mut Self::Sums);
    /// Lane by lane, wrapping.
    fn add(self, other: Self) -> Self;
}

/// A vector of block sums or fused costs in lanes of type `L`.
pub trait Block<L>: Copy {
    /// The vector in memory.
    type Costs: Pod;
    /// The vector of column sums with as many lanes.
    type Column: Column;

    /// Stores the costs.
    fn store(self, costs: &mut Self::Costs);
    /// Slides the block by a column: adds the column that enters and subtracts the one that leaves. Their
    /// difference fits 16 bits with a sign.
    fn slide(self, entering: Self::Column, leaving: Self::Column) -> Self;
    /// Lane by lane. 16-bit lanes saturate; 32-bit lanes never reach their limit.
    fn add(self, other: Self) -> Self;
    /// Lane by lane.
    fn min(self, other: Self) -> Self;
    /// Lane by lane.
    fn max(self, other: Self) -> Self;
    /// Lane by lane `then` where `self > other`, and `otherwise` elsewhere.
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self;
    /// The least of all lanes.
    fn least(self) -> L;

    /// The lanes in the order of the disparities, if pixels go in batches.
    #[inline(always)]
    fn ordered(self) -> Self {
        self
    }
}
