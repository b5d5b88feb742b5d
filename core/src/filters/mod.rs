//! Filters of disparity lines, as they stream. Each takes lines from a matcher or from another filter: [`MedianLines`] the median
//! over 3 x 3 pixels; [`TextureLines`], in a module of its own, removes disparities where there is too little texture.

mod texture_lines;

use crate::{Disparity, MatchError, MemoryTooSmall, SearchSpace, infallible};
pub use texture_lines::{CenterLines, ObservedSource, TextureLines, slopes};

/// Invalidates the disparities of a line that are less sure than `least`, a probability times 255. An invalid pixel has
/// the confidence 0.
pub fn filter_by_confidence(least: u8, disparities: &mut [Option<Disparity>], confidences: &mut [u8]) {
    for (disparity, confidence) in disparities.iter_mut().zip(confidences) {
        *disparity = disparity.filter(|_| *confidence >= least);
        if disparity.is_none() {
            *confidence = 0;
        }
    }
}

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
    pub fn new(search: &SearchSpace, memory: &'m mut [u32]) -> Result<MedianLines<'m>, MemoryTooSmall> {
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

/// Lines of disparities and grades of peak ratios, up to `REACH` lines above and below the one that is next.
#[derive(Debug)]
pub(crate) struct MatchedLines<'m, const REACH: usize> {
    width: usize,
    height: usize,
    /// The last `2 REACH + 1` lines.
    disparities: &'m mut [Option<Disparity>],
    /// The last `REACH + 1` lines.
    peaks: &'m mut [u8],
    /// Lines that the matcher has yielded.
    line_count: usize,
    /// The next line.
    next: usize,
}

impl<const REACH: usize> MatchedLines<'_, REACH> {
    const DISPARITIES: usize = 2 * REACH + 1;
    const PEAKS: usize = REACH + 1;

    /// The words of memory for lines of `width` columns.
    pub const fn memory_words(width: usize) -> usize {
        infallible::div_ceil(width * (2 * Self::DISPARITIES + Self::PEAKS), size_of::<u32>())
    }
}

impl<'m, const REACH: usize> MatchedLines<'m, REACH> {
    /// No lines yet, of frames of the size of `search`. `memory` has any content.
    pub fn new(search: &SearchSpace, memory: &'m mut [u32]) -> Result<MatchedLines<'m, REACH>, MemoryTooSmall> {
        let (width, height) = (search.width(), search.height());
        let too_small = MemoryTooSmall { needed: Self::memory_words(width), given: memory.len() };
        let bytes: &mut [u8] = infallible::cast_mut(memory);
        let (disparities, peaks) = bytes.split_at_mut_checked(2 * Self::DISPARITIES * width).ok_or(too_small)?;
        let disparities = bytemuck::try_cast_slice_mut(disparities).map_err(|_| too_small)?;
        let peaks = peaks.get_mut(..Self::PEAKS * width).ok_or(too_small)?;
        Ok(MatchedLines { width, height, disparities, peaks, line_count: 0, next: 0 })
    }

    /// Goes on to the next line and returns its index, or `None` after the last: all lines that it needs are there, the last of
    /// them from `matched`. The lines of output have these `lengths`.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn advance<E>(
        &mut self,
        mut matched: impl FnMut(&mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, MatchError<E>>,
        lengths: [usize; 2],
    ) -> Result<Option<usize>, MatchError<E>> {
        let needed = self.width;
        if let Some(&given) = lengths.iter().find(|&&given| given != needed) {
            return Err(MatchError::OutputLength { needed, given });
        }
        let v = self.next;
        if v >= self.height {
            return Ok(None);
        }
        while self.line_count <= (self.height - 1).min(v + REACH) {
            let line = slot_mut(self.disparities, self.line_count % Self::DISPARITIES, needed);
            if matched(line, slot_mut(self.peaks, self.line_count % Self::PEAKS, needed))?.is_none() {
                return Ok(None);
            }
            self.line_count += 1;
        }
        self.next += 1;
        Ok(Some(v))
    }

    /// The number of lines.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The disparities of line `v`, or of the last if the frame is not as high.
    #[inline(always)]
    pub fn disparities(&self, v: usize) -> &[Option<Disparity>] {
        slot(self.disparities, v.min(self.height - 1) % Self::DISPARITIES, self.width)
    }

    /// The grades of line `v`.
    #[inline(always)]
    pub fn peaks(&self, v: usize) -> &[u8] {
        slot(self.peaks, v % Self::PEAKS, self.width)
    }
}

/// A line of those that are kept.
fn slot<T>(lines: &[T], index: usize, width: usize) -> &[T] {
    lines.get(index * width..(index + 1) * width).unwrap_or_default()
}

/// A line of those that are kept, to be written.
fn slot_mut<T>(lines: &mut [T], index: usize, width: usize) -> &mut [T] {
    lines.get_mut(index * width..(index + 1) * width).unwrap_or_default()
}

/// Copies as many as fit: unlike `copy_from_slice`, it has no panic.
pub(crate) fn copy_to<T: Copy>(to: &mut [T], from: &[T]) {
    to.iter_mut().zip(from).for_each(|(to, &from)| *to = from);
}
