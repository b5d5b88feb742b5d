//! What a vector is.

/// The lanes of a vector.
pub const LANES: usize = 32;

/// A set of vector instructions, which makes vectors. It is implemented by the tokens of the core's kernels,
/// which only exist on processors that have the instructions.
pub trait Vectors: Copy {
    /// 32 lanes of 16 bits.
    type Vector: Vector;

    /// A vector with `value` in every lane.
    fn splat(self, value: u16) -> Self::Vector;
    /// A vector from memory.
    fn load(self, values: &[u16; LANES]) -> Self::Vector;
    /// The Hamming distances of `descriptor` and 32 others, whose first bytes are in `descriptors[0]`, and so
    /// on.
    fn hamming_distances<const BYTES: usize>(self, descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> Self::Vector;
}

/// Operations on a vector, lane by lane unless they say otherwise.
pub trait Vector: Copy {
    /// Writes the lanes to memory.
    fn store(self, values: &mut [u16; LANES]);
    /// The minimum.
    fn min(self, other: Self) -> Self;
    /// The maximum.
    fn max(self, other: Self) -> Self;
    /// The sum, at most `u16::MAX`.
    fn saturating_add(self, other: Self) -> Self;
    /// The difference, at least 0.
    fn saturating_sub(self, other: Self) -> Self;
    /// `then` where this is greater than `other`, `otherwise` elsewhere.
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self;
    /// The minimum of all lanes.
    fn min_lane(self) -> u16;
    /// A mask with a bit for each lane that equals that of `other`, lane 0 in the least significant bit.
    fn equal_mask(self, other: Self) -> u32;
}
