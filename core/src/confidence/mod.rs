//! Confidence: the probability that a disparity is right, from the peak ratio of its costs and from the disparities around it.
//!
//! [`ConfidenceTable`] has the probabilities by the peak ratio and by how many pixels around agree.

mod table;

use crate::{
    Disparity, MatchError, MemoryTooSmall, SearchSpace,
    filters::{MatchedLines, copy_to},
    kernel::{Isa, Native},
};
pub use table::ConfidenceTable;

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
    /// The least grade, not 0, beside an end of the search.
    const CLEAR: u8 = 14;

    /// The grade of the candidate at `index` of `count`, from 0 to 15: its ratio `256 (second - least) / (second + unit)` in half
    /// octaves. The grades begin at ratios of 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128 and 192.
    ///
    /// The first and the last have a grade of 0, since a better one may lie beyond. So have those beside them if their own is
    /// below 14: what is cut off by the range gathers there.
    #[inline(always)]
    pub fn grade(self, index: usize, count: usize) -> u8 {
        let grade = half_octaves(self.ratio());
        match index.min(count.wrapping_sub(1).wrapping_sub(index)) {
            0 => 0,
            1 if grade < Self::CLEAR => 0,
            _ => grade,
        }
    }

    /// The [grade](PeakRatio::grade) of the candidate at `index` of `count`, which is 0 without a second one, and whether it is
    /// unique enough.
    #[inline(always)]
    pub(crate) fn judge(ratio: Option<PeakRatio>, index: usize, count: usize, uniqueness_ratio: Option<u8>) -> (u8, bool) {
        let Some(ratio) = ratio else { return (0, true) };
        (ratio.grade(index, count), uniqueness_ratio.is_none_or(|percent| ratio.is_unique(percent)))
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

/// Computes the confidences of a frame's disparities line by line, from disparity lines as a matcher yields them.
///
/// It keeps eleven lines, and is five lines behind the matcher.
///
/// ```
/// use multiscopic_core::{
///     BlockMatchingParams, ConfidenceLines, ConfidenceTable, Frame, Fusion, Matcher, ScanlineSource, SearchConfig, Views, valid,
/// };
///
/// /// A texture, seen three pixels further to each side.
/// struct Texture;
///
/// impl ScanlineSource for Texture {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = match frame {
///             Frame::Center => 0,
///             Frame::View(view) => view.shift(3).0,
///         };
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = ((u - shift + 7 * v as i32) * (u - shift) % 251) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(80, 30) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(5));
/// let mut memory = [0; PARAMS.memory_words()];
/// let mut lines_memory = [0; ConfidenceLines::memory_words(PARAMS.width())];
/// let mut matcher = Matcher::new(&PARAMS, &mut memory)?;
/// let mut lines = ConfidenceLines::new(PARAMS.search(), &ConfidenceTable::BLOCK_MATCHING, &mut lines_memory)?;
/// let (mut disparities, mut confidences) = ([None; PARAMS.width()], [0; PARAMS.width()]);
/// while let Some(_v) = lines.next_line(
///     |disparities, peaks| matcher.next_line_and_peaks(&mut Texture, disparities, peaks),
///     &mut disparities,
///     &mut confidences,
/// )? {
///     assert_eq!(disparities[40].map(f32::from), Some(3.0));
///     assert!(confidences[40] > 200);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ConfidenceLines<'m, I = Native> {
    isa: I,
    table: &'m ConfidenceTable,
    lines: MatchedLines<'m, { ConfidenceTable::ROWS }>,
}

impl ConfidenceLines<'_> {
    /// The number of lines by which the confidences are behind the disparities.
    pub const LATENCY_LINES: usize = ConfidenceTable::ROWS;

    /// The words of memory for a frame of `width` columns: 28 bytes for each.
    pub const fn memory_words(width: usize) -> usize {
        MatchedLines::<{ ConfidenceTable::ROWS }>::memory_words(width)
    }
}

impl<'m> ConfidenceLines<'m> {
    /// No lines yet, of frames of the size of `search`, with the [kernel](Native) that the target is compiled for.
    ///
    /// `memory` has at least [`memory_words`](ConfidenceLines::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        search: &SearchSpace,
        table: &'m ConfidenceTable,
        memory: &'m mut [u32],
    ) -> Result<ConfidenceLines<'m>, MemoryTooSmall> {
        ConfidenceLines::with_isa(Native::default(), search, table, memory)
    }
}

impl<'m, I: Isa> ConfidenceLines<'m, I> {
    /// [`new`](ConfidenceLines::new) with an instruction set.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn with_isa(
        isa: I,
        search: &SearchSpace,
        table: &'m ConfidenceTable,
        memory: &'m mut [u32],
    ) -> Result<ConfidenceLines<'m, I>, MemoryTooSmall> {
        Ok(ConfidenceLines { isa, table, lines: MatchedLines::new(search, memory)? })
    }

    /// Computes the next line, and returns its index in the frame, or `None` after the last. `matched` computes the next line of
    /// disparities and peak ratios: [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), for the whole frame,
    /// [`SemiGlobalMatcher::next_line_and_peaks`](crate::SemiGlobalMatcher::next_line_and_peaks), or a
    /// [filter](crate::MedianLines) of these.
    ///
    /// # Errors
    /// Those of `matched`, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next_line<E>(
        &mut self,
        matched: impl FnMut(&mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, MatchError<E>>,
        disparities: &mut [Option<Disparity>],
        confidences: &mut [u8],
    ) -> Result<Option<usize>, MatchError<E>> {
        let Some(v) = self.lines.advance(matched, [disparities.len(), confidences.len()])? else { return Ok(None) };
        let rows = [-(ConfidenceTable::ROWS as isize), 0, ConfidenceTable::ROWS as isize];
        let rows = rows.map(|offset| self.lines.disparities(v.saturating_add_signed(offset)));
        self.table.line_with_isa(self.isa, rows, self.lines.peaks(v), confidences);
        copy_to(disparities, rows[1]);
        Ok(Some(v))
    }
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
    fn grades_are_half_octaves_and_none_at_the_ends() {
        let begins = [0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192];
        let grade = |ratio: u32| begins.iter().filter(|begin| **begin <= ratio).count() as u8 - 1;
        for rise in 0..256 {
            let ratio = PeakRatio { least: 1000 - rise, second: 1000, unit: 24 };
            let expected = rise * 256 / 1024;
            let inner = grade(expected);
            let beside = if expected < 128 { 0 } else { inner };
            assert_eq!([0, 1, 2, 3, 4].map(|index| ratio.grade(index, 5)), [0, beside, inner, beside, 0]);
            assert_eq!([0, 1, 2].map(|index| ratio.grade(index, 3)), [0, beside, 0]);
        }
        assert!((0..256).all(|ratio| half_octaves(ratio) == grade(ratio)));
    }
}
