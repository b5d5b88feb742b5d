//! The number of bits of 16-bit samples that carry values.

use serde::{Deserialize, Serialize};

/// The number of bits in which a camera measured brightness before its samples were stored in 16 bits.
///
/// White is the largest number of that many bits. Left-justified samples, whose low bits are 0, have 16 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum BitDepth {
    /// 10 bits: white is 1023.
    Ten,
    /// 12 bits: white is 4095.
    Twelve,
    /// 14 bits: white is 16383.
    Fourteen,
    /// 16 bits: white is 65535.
    Sixteen,
}

impl BitDepth {
    /// All depths, from the least to the greatest.
    pub const ALL: [BitDepth; 4] = [BitDepth::Ten, BitDepth::Twelve, BitDepth::Fourteen, BitDepth::Sixteen];

    /// The number of bits: 10, 12, 14 or 16.
    pub const fn bits(self) -> u8 {
        match self {
            BitDepth::Ten => 10,
            BitDepth::Twelve => 12,
            BitDepth::Fourteen => 14,
            BitDepth::Sixteen => 16,
        }
    }

    /// The sample of white, which is the largest.
    pub const fn white(self) -> u16 {
        u16::MAX >> (16 - self.bits())
    }

    /// The least depth that has this sample.
    pub fn of_brightest(sample: u16) -> BitDepth {
        BitDepth::ALL.into_iter().find(|depth| sample <= depth.white()).unwrap_or(BitDepth::Sixteen)
    }

    /// A sample of this depth on the scale of 16 bits: 65535 times the sample through [`white`](BitDepth::white), rounded to
    /// nearest. Samples above white are white.
    pub fn to_16_bits(self, sample: u16) -> u16 {
        let white = u32::from(self.white());
        // White is odd, so no quotient is halfway between two numbers.
        ((u32::from(sample).min(white) * 65535 + white / 2) / white) as u16
    }
}

/// A sample of 16 bits in 8: 255 times the sample through 65535, rounded to nearest.
pub(crate) fn to_8_bits(sample: u16) -> u8 {
    ((u32::from(sample) + 128) / 257) as u8
}

impl From<BitDepth> for u8 {
    fn from(depth: BitDepth) -> u8 {
        depth.bits()
    }
}

impl TryFrom<u8> for BitDepth {
    type Error = String;

    fn try_from(bits: u8) -> Result<BitDepth, String> {
        let depth = BitDepth::ALL.into_iter().find(|depth| depth.bits() == bits);
        depth.ok_or_else(|| format!("{bits} bits, expected 10, 12, 14 or 16"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_every_depth_are_rounded_to_nearest() {
        for depth in BitDepth::ALL {
            let white = f64::from(depth.white());
            for sample in 0..=depth.white() {
                let share = f64::from(sample) / white;
                let deep = depth.to_16_bits(sample);
                assert_eq!(f64::from(deep), (65535.0 * share).round(), "{sample} of {depth:?}");
                // Both steps together round as one.
                assert_eq!(f64::from(to_8_bits(deep)), (255.0 * share).round(), "{sample} of {depth:?}");
            }
        }
        assert_eq!(BitDepth::Ten.to_16_bits(1024), 65535);
    }

    #[test]
    fn the_brightest_sample_tells_the_depth() {
        let depths = [0, 1023, 1024, 4095, 4096, 16383, 16384, 65535].map(|sample| BitDepth::of_brightest(sample).bits());
        assert_eq!(depths, [10, 10, 12, 12, 14, 14, 16, 16]);
    }

    #[test]
    fn other_numbers_of_bits_are_refused() {
        assert_eq!(BitDepth::try_from(14), Ok(BitDepth::Fourteen));
        assert_eq!(BitDepth::try_from(11), Err("11 bits, expected 10, 12, 14 or 16".into()));
    }
}
