//! From fused sums of absolute differences to matching costs of 8 bits.

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
