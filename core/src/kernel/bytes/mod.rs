//! Costs in 8-bit lanes, as semi-global matching has them.
//!
//! An instruction set implements the operations of [`Bytes`]. The loops of [`PixelLoops`] and [`RunLoops`]
//! consist of them, and may be overridden. Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `paths` | the recursion along paths, and a path along a line in registers: [`Slot`], [`Step`], [`LinePath`] |
//! | `hamming` | matching costs by the census transform: [`Candidates`], [`hamming_run`], [`DistanceFusion`] |
//! | `loops` | the loops over the disparities of a pixel, and paths through many pixels: [`PixelLoops`], [`RunLoops`] |

mod hamming;
mod loops;
mod paths;

use super::blocks::Blocks;
#[cfg(multiscopic_mve)]
pub(super) use hamming::hamming_loop;
pub use hamming::{CandidateRun, Candidates, DistanceFusion, hamming_run, mean_of_inliers, trimmed_mean};
pub use loops::{BackwardRun, ForwardRun, Kernel, PixelLoops, PixelPaths, RunLoops, RunPenalties};
#[cfg(multiscopic_dsp)]
pub(super) use loops::{backward_loop, forward_loop};
pub use paths::{LinePath, Slot, Step};

/// A vector of costs in lanes of 8 bits. A candidate that does not exist has the cost 255.
pub trait ByteVector: Copy {
    /// The vector in memory.
    type Memory;

    /// Stores the costs.
    fn store(self, costs: &mut Self::Memory);
    /// Lane by lane, saturating at 255.
    fn add(self, other: Self) -> Self;
    /// Lane by lane, saturating at 0.
    fn sub(self, other: Self) -> Self;
    /// Lane by lane.
    fn min(self, other: Self) -> Self;
    /// Lane by lane.
    fn max(self, other: Self) -> Self;
    /// Lane by lane `then` where `self > other`, and `otherwise` elsewhere.
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self;
    /// Half of each lane, rounded down.
    fn halved(self) -> Self;
    /// A third of each lane, rounded down. Lanes are at most 127.
    fn third(self) -> Self;
    /// The least of all lanes.
    fn least(self) -> u8;
    /// The least of all lanes, in each lane.
    fn least_in_each(self) -> Self;
    /// Each lane as it is in the lane above it; the first one as the last of `previous`, the vector before.
    fn moved_up(self, previous: Self) -> Self;
    /// Each lane as it is in the lane below it; the last one as the first of `next`, the vector after.
    fn moved_down(self, next: Self) -> Self;
}

/// An instruction set with vectors of 8-bit costs, as many lanes as [`LANES`](crate::kernel::Isa::LANES).
pub trait Bytes: Blocks<u16> + Blocks<u32> {
    /// A vector of costs.
    type Bytes: ByteVector<Memory = Self::Samples>;

    /// Loads costs.
    fn load_bytes(self, costs: &Self::Samples) -> Self::Bytes;
    /// The same cost in every lane.
    fn splat_byte(self, cost: u8) -> Self::Bytes;
    /// The index of each lane.
    fn byte_indices(self) -> Self::Bytes;
    /// The number of bits in which a descriptor of `N` bytes differs from others, whose bytes are in planes.
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&Self::Samples; N]) -> Self::Bytes;
}

/// Bytes as whole vectors.
#[inline(always)]
pub fn as_vectors<I: Bytes>(bytes: &[u8]) -> &[I::Samples] {
    let whole = bytes.len() / I::LANES * I::LANES;
    let Some(bytes) = bytes.get(..whole) else { return &[] };
    match bytemuck::try_cast_slice(bytes) {
        Ok(vectors) => vectors,
        Err(_) => &[],
    }
}

/// Bytes as whole vectors.
#[inline(always)]
pub fn as_vectors_mut<I: Bytes>(bytes: &mut [u8]) -> &mut [I::Samples] {
    let whole = bytes.len() / I::LANES * I::LANES;
    let Some(bytes) = bytes.get_mut(..whole) else { return &mut [] };
    match bytemuck::try_cast_slice_mut(bytes) {
        Ok(vectors) => vectors,
        Err(_) => &mut [],
    }
}

/// By what fused sums of absolute differences are divided to become matching costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Divisor {
    /// The power of two.
    pub shift: u32,
    /// True if they are divided by three as well.
    pub by_three: bool,
}

impl Divisor {
    /// The quotient, rounded down, or [`limit`](Divisor::LIMIT) if it is greater.
    #[inline(always)]
    pub const fn divide(self, sum: u16) -> u8 {
        let shifted = sum as u32 >> self.shift;
        let quotient = if self.by_three {
            // Exact up to 3 x 170 + 2, with a product below 2^16.
            ((if shifted < Divisor::MOST_THIRDS { shifted } else { Divisor::MOST_THIRDS }) * 171) >> 9
        } else {
            shifted
        };
        (if quotient < Divisor::LIMIT as u32 { quotient } else { Divisor::LIMIT as u32 }) as u8
    }

    /// The greatest matching cost.
    pub const LIMIT: u8 = crate::SemiGlobalParams::MAX_COST;

    /// The least dividend of three whose quotient is the greatest cost, and a little more.
    pub const MOST_THIRDS: u32 = 3 * Divisor::LIMIT as u32 + 2;
}
