//! An output of a layer in whole numbers: sums of products, brought back to the scale of activations.

/// The start of an output's sums, and their way to activations: by a shift, a multiplication and a rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuantizedOutput {
    /// The start of its sum.
    pub bias: i32,
    /// Bits by which the sum is shifted down.
    pub shift: u8,
    /// The factor that follows, in 2^-15.
    pub multiplier: u16,
}

impl QuantizedOutput {
    /// The largest bias, whatever its sign: no sum of products from there on leaves 32 bits.
    pub const MAX_BIAS: u32 = 1 << 30;
    /// The most that a sum is shifted by.
    pub const MAX_SHIFT: u8 = 31;
    /// The largest multiplier.
    pub const MAX_MULTIPLIER: u16 = 0x7fff;

    /// The output by its sum: shifted, clamped to 16 bits, multiplied and rounded half up.
    #[inline(always)]
    pub fn scaled(sum: i32, shift: i32, multiplier: i32) -> i16 {
        // A sum in 16 bits times a multiplier of 15 bits fits 32 bits.
        let shifted = (sum >> (shift & i32::from(Self::MAX_SHIFT))).clamp(i16::MIN.into(), i16::MAX.into());
        ((shifted * multiplier + (1 << 14)) >> 15) as i16
    }

    /// The output by its sum.
    #[inline(always)]
    pub fn of(&self, sum: i32) -> i16 {
        Self::scaled(sum, self.shift.into(), self.multiplier.into())
    }
}
