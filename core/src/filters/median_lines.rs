//! The median filter.

use super::matched_lines::{MatchedLines, copy_to};
use crate::{Disparity, MatchError, MemoryTooSmall, Search};

/// Computes the median of a frame's disparities over 3 x 3 pixels line by line, from disparity lines as a matcher yields them.
///
/// Invalid pixels stay invalid and never count, nor do those beyond the borders; of an even number of disparities it takes the
/// upper median. Grades of peak ratios, of which confidences are computed, stay those of their pixels. It keeps three lines, and
/// is one line behind the matcher.
///
/// ```
/// use multiscopic_core::{Disparity, MatchError, MedianLines, SearchConfig};
///
/// let search = SearchConfig { num_disparities: 16, ..SearchConfig::of_size(40, 30) }.checked()?;
/// let mut memory = [0; MedianLines::memory_words(40)];
/// let mut lines = MedianLines::new(&search, &mut memory)?;
/// let (mut disparities, mut peaks) = ([None; 40], [0; 40]);
/// // In place of a matcher: a plane with a speckle. Grades may stay as they are without confidences.
/// let mut v = 0;
/// let mut matched = |line: &mut [Option<Disparity>], _: &mut [u8]| -> Result<_, MatchError<()>> {
///     line.fill(Disparity::whole(3));
///     line[20] = Disparity::whole(if v == 15 { 12 } else { 3 });
///     v += 1;
///     Ok(Some(v - 1))
/// };
/// while let Ok(Some(_v)) = lines.next_line(&mut matched, &mut disparities, &mut peaks) {
///     assert_eq!(disparities, [Disparity::whole(3); 40]);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct MedianLines<'m> {
    lines: MatchedLines<'m, { MedianLines::LATENCY_LINES }>,
}

impl MedianLines<'_> {
    /// The number of lines by which the medians are behind the disparities.
    pub const LATENCY_LINES: usize = 1;

    /// The words of memory for a frame of `width` columns: 8 bytes for each.
    pub const fn memory_words(width: usize) -> usize {
        MatchedLines::<{ MedianLines::LATENCY_LINES }>::memory_words(width)
    }
}

impl<'m> MedianLines<'m> {
    /// No lines yet, of frames of the size of `search`.
    ///
    /// `memory` has at least [`memory_words`](MedianLines::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(search: &Search, memory: &'m mut [u32]) -> Result<MedianLines<'m>, MemoryTooSmall> {
        Ok(MedianLines { lines: MatchedLines::new(search, memory)? })
    }

    /// Computes the next line, and returns its index in the frame, or `None` after the last. `matched` computes the next line of
    /// disparities and peak ratios: [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), for the whole frame,
    /// or
    /// [`SemiGlobalMatcher::next_line_and_peaks`](crate::SemiGlobalMatcher::next_line_and_peaks).
    ///
    /// # Errors
    /// Those of `matched`, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    pub fn next_line<E>(
        &mut self,
        matched: impl FnMut(&mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, MatchError<E>>,
        disparities: &mut [Option<Disparity>],
        peaks: &mut [u8],
    ) -> Result<Option<usize>, MatchError<E>> {
        let Some(v) = self.lines.advance(matched, [disparities.len(), peaks.len()])? else { return Ok(None) };
        let around = [v.checked_sub(1), Some(v), Some(v + 1).filter(|below| *below < self.lines.height())];
        let rows = around.map(|v| v.map_or(&[][..], |v| self.lines.disparities(v)));
        median_line(rows, disparities);
        copy_to(peaks, self.lines.peaks(v));
        Ok(Some(v))
    }
}

type Column = [Option<Disparity>; 3];

/// The medians of a line and the lines around it, which are empty beyond the frame.
fn median_line(rows: [&[Option<Disparity>]; 3], medians: &mut [Option<Disparity>]) {
    let column = |u: usize| sorted(rows.map(|row| row.get(u).copied().flatten()));
    let mut columns = [[None; 3], [None; 3], column(0)];
    for (u, median) in medians.iter_mut().enumerate() {
        columns = [columns[1], columns[2], column(u + 1)];
        *median = match rows[1].get(u) {
            Some(Some(_)) => upper_median(&columns),
            _ => None,
        };
    }
}

/// The upper median of the valid pixels of three sorted columns. Invalid ones come first in the order of pixels.
fn upper_median(columns: &[Column; 3]) -> Option<Disparity> {
    let [least, middle, greatest] = [0, 1, 2].map(|k| columns.map(|column| column[k]));
    if least.iter().all(Option::is_some) {
        return sorted([sorted(least)[2], sorted(middle)[1], sorted(greatest)[0]])[1];
    }
    let valid = || columns.iter().flatten().flatten();
    let middle = valid().count() / 2;
    valid().copied().find(|pixel| {
        let (less, equal) = (valid().filter(|other| *other < pixel).count(), valid().filter(|other| *other == pixel).count());
        (less..less + equal).contains(&middle)
    })
}

/// Three pixels from the least to the greatest.
fn sorted([a, b, c]: Column) -> Column {
    let (a, b) = (a.min(b), a.max(b));
    let (b, c) = (b.min(c), b.max(c));
    [a.min(b), a.max(b), c]
}
