//! How much worse the next best candidate is.

/// How much worse the next best candidate is than the one of least cost: the peak ratio of Hu and Mordohai, "A quantitative
/// evaluation of confidence measures for stereo vision", 2012, with a floor of noise. All costs are on one scale, and below
/// 2^30.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PeakRatio {
    /// The least cost.
    pub least: u32,
    /// The least cost of the candidates more than one disparity away, not less than `least`.
    pub second: u32,
    /// The cost of the noise that is to be expected, not 0.
    pub unit: u32,
}

impl PeakRatio {
    /// `256 (second - least) / (second + unit)`, rounded down, of the candidate at `index`, halved if it is the first or the
    /// last of `count`, where a better one may lie beyond.
    #[inline(always)]
    pub fn at(self, index: usize, count: usize) -> u8 {
        let (rise, sum) = (self.second.wrapping_sub(self.least), self.second.wrapping_add(self.unit));
        let ratio = match rise < 1 << 24 {
            true => (rise << 8).checked_div(sum).unwrap_or_default(),
            false => long_division(rise, sum),
        };
        (if index == 0 || index + 1 == count { ratio / 2 } else { ratio }) as u8
    }
}

/// `256 rise / sum`, rounded down, bit by bit: only the mean of five views or more has costs that do not fit 24 bits.
#[cold]
fn long_division(mut rise: u32, sum: u32) -> u32 {
    let mut ratio = 0;
    for _ in 0..8 {
        rise <<= 1;
        ratio <<= 1;
        if rise >= sum {
            rise -= sum;
            ratio += 1;
        }
    }
    ratio
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_costs_have_the_same_ratio() {
        for (least, second, unit) in [(0, 94_000_000, 370_440), (1, 1 << 24, 9), (17_000_000, 90_000_000, 840), (5, 5, 1)] {
            let rise = u64::from(second - least);
            let expected = 256 * rise / u64::from(second + unit);
            let ratio = PeakRatio { least, second, unit };
            assert_eq!([ratio.at(1, 3), ratio.at(0, 3), ratio.at(2, 3)].map(u64::from), [expected, expected / 2, expected / 2]);
            assert_eq!(u64::from(long_division(second - least, second + unit)), expected);
        }
    }
}
