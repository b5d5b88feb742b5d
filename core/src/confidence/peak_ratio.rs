//! The ratio by which the next best candidate is worse than the best.

/// The ratio by which the next best candidate is worse than the one of least cost: the peak ratio of Hu and Mordohai, "A
/// quantitative evaluation of confidence measures for stereo vision", 2012, with a floor of noise. All costs are on one
/// scale, and below 2^30.
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
    /// The grade of the candidate at `index` of `count`, from 0 to 15: its ratio `256 (second - least) / (second + unit)`, halved
    /// if it is the first or the last, where a better one may lie beyond, in half octaves. The grades begin at ratios of 0, 1, 2,
    /// 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128 and 192.
    #[inline(always)]
    pub fn grade(self, index: usize, count: usize) -> u8 {
        self.grade_at(index == 0 || index + 1 == count)
    }

    /// The [grade](PeakRatio::grade) of a candidate that is at an end of the search, or not.
    #[inline(always)]
    fn grade_at(self, is_end: bool) -> u8 {
        let ratio = self.ratio();
        half_octaves(if is_end { ratio / 2 } else { ratio })
    }

    /// The [grade](PeakRatio::grade) of a candidate that is at an end of the search, or not, which is 0 without a second one, and
    /// whether it is unique enough.
    #[inline(always)]
    pub(crate) fn judge(ratio: Option<PeakRatio>, is_end: bool, uniqueness_ratio: Option<u8>) -> (u8, bool) {
        let Some(ratio) = ratio else { return (0, true) };
        (ratio.grade_at(is_end), uniqueness_ratio.is_none_or(|percent| ratio.is_unique(percent)))
    }

    /// True if the second candidate costs over `percent` of the least cost more than that: the uniqueness ratio of OpenCV's
    /// StereoBM.
    #[inline(always)]
    pub const fn is_unique(self, percent: u8) -> bool {
        let rise = self.second.wrapping_sub(self.least);
        100 * rise as u64 > self.least as u64 * percent as u64
    }

    /// Less than 256.
    #[inline(always)]
    fn ratio(self) -> u32 {
        let (rise, sum) = (self.second.wrapping_sub(self.least), self.second.wrapping_add(self.unit));
        match rise < 1 << 24 {
            true => (rise << 8).checked_div(sum).unwrap_or_default(),
            false => long_division(rise, sum),
        }
    }
}

/// Twice the octave of a ratio below 256, and one more in its upper half.
#[inline(always)]
fn half_octaves(ratio: u32) -> u8 {
    let octave = ratio.checked_ilog2().unwrap_or_default();
    (if octave < 2 { ratio } else { 2 * octave + (ratio >> (octave - 1) & 1) }) as u8
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
            assert_eq!(u64::from(PeakRatio { least, second, unit }.ratio()), expected);
            assert_eq!(u64::from(long_division(second - least, second + unit)), expected);
        }
    }

    #[test]
    fn grades_are_half_octaves_and_lower_at_the_ends() {
        let begins = [0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192];
        let grade = |ratio: u32| begins.iter().filter(|begin| **begin <= ratio).count() as u8 - 1;
        for rise in 0..256 {
            let ratio = PeakRatio { least: 1000 - rise, second: 1000, unit: 24 };
            let expected = rise * 256 / 1024;
            assert_eq!([1, 0, 2].map(|index| ratio.grade(index, 3)), [expected, expected / 2, expected / 2].map(grade));
        }
        assert!((0..256).all(|ratio| half_octaves(ratio) == grade(ratio)));
    }
}
