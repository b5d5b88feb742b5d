//! Instruction sets and their vectors.

use core::fmt::Debug;

use bytemuck::Pod;

/// A loop over the views `k` of `V` that is always unrolled: what belongs to each then stays in registers, as far as there are any.
macro_rules! each_view {
    ($k:ident, $body:block) => { each_view!($k, $body, 0 1 2 3 4 5 6 7) };
    ($k:ident, $body:block, $($index:literal)+) => {
        $(if const { $index < V } {
            let $k = $index;
            $body
        })+
    };
}

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

/// The most pixels in a batch.
pub const MAX_BATCH: usize = 32;

/// Only this crate implements [`Isa`]: unsafe code relies on its constants and on the sizes of its types.
pub(super) mod sealed {
    pub trait Sealed {}
}

/// A set of vector instructions, as a token: who holds one may use them.
///
/// Lanes past the last disparity hold arbitrary values, so arithmetic wraps.
pub trait Isa: sealed::Sealed + Copy + Debug {
    /// Disparities in a vector, at least 1. The number of disparities is rounded up to a multiple.
    const LANES: usize;
    /// Pixels whose costs are fused before their disparities are selected, from 1 to [`MAX_BATCH`].
    ///
    /// Selecting has a long latency, but pixels do not wait for each other: an out-of-order processor
    /// overlaps those of a batch.
    const BATCH: usize;
    /// A vector of samples in memory, a byte each.
    type Samples: Pod;
    /// A vector of column sums in memory.
    type Sums: Pod;
    /// A vector of column sums.
    type Column: Column<Sums = Self::Sums>;

    /// The lane in memory, of column sums and of costs, that holds the disparity at `index` of a vector.
    fn lane(index: usize) -> usize {
        index
    }

    /// Runs work in a function compiled for the instruction set.
    #[inline(always)]
    fn compiled<W: Work>(self, work: W) {
        work.run();
    }

    /// Loads column sums.
    fn load_column(self, sums: &Self::Sums) -> Self::Column;
    /// The absolute differences between a sample of the centre and the samples of a view.
    fn differences(self, center: u8, view: &Self::Samples) -> Self::Column;
    /// Moves column sums down by a line: adds the differences of the line that enters and subtracts those of
    /// the one that leaves. Wraps.
    ///
    /// It may add [`bias(1)`](Isa::bias) as well.
    fn advance(self, sums: Self::Column, center: Change<u8>, view: Change<&Self::Samples>) -> Self::Column;

    /// True if [`count_within`](Isa::count_within) is faster than counting in lanes of the compiler's choice.
    const COUNTS_HALVES: bool = false;

    /// Adds 1 to each half of `counts` if that half of `values` is not below that of `least`, and exceeds it by at most that of
    /// `span`.
    #[inline(always)]
    fn count_within(self, values: u32, least: u32, span: u32, counts: u32) -> u32 {
        let is_within = |shift: u32| {
            let [value, least, span] = [values, least, span].map(|word| (word >> shift) as u16);
            u32::from(value.wrapping_sub(least) <= span) << shift
        };
        counts + is_within(0) + is_within(16)
    }

    /// Adds the products of signed weights and inputs, each at most 127, to a sum for each of four positions. There are as many
    /// inputs at each as weights, a multiple of 4.
    #[inline(always)]
    fn add_products(self, mut sums: [i32; 4], weights: &[u8], inputs: [&[u8]; 4]) -> [i32; 4] {
        for (sum, inputs) in sums.iter_mut().zip(inputs) {
            let products = weights.iter().zip(inputs).map(|(&weight, &input)| i32::from(weight.cast_signed()) * i32::from(input));
            *sum = sum.wrapping_add(products.sum());
        }
        sums
    }

    /// The excess in every column sum after it has moved down by a number of lines. Block sums are free of
    /// it: what a column adds on entering, it takes away on leaving.
    fn bias(_lines: u32) -> u16 {
        0
    }
}

/// Work that is compiled for an instruction set, if the compiler may use fewer instructions elsewhere.
pub trait Work {
    /// Does the work. Implementations are inlined.
    fn run(self);
}

/// The value that enters the block, and the one that leaves it.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Change<T> {
    /// The value that enters.
    pub entering: T,
    /// The value that leaves.
    pub leaving: T,
}

/// The properties of an instruction set that unsafe code relies on.
pub(super) const fn assert_layout<I: Isa>() {
    assert!(I::LANES > 0 && I::BATCH > 0 && I::BATCH <= MAX_BATCH, "the lanes or the batch are out of range");
    assert!(size_of::<I::Samples>() == I::LANES && align_of::<I::Samples>() == 1, "samples are not bytes");
    assert!(size_of::<I::Sums>() == I::LANES * size_of::<u16>(), "column sums do not have 16 bits");
}
