//! The last lines from a matcher.

use crate::{Disparity, MatchError, MemoryTooSmall, Search};

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
    matched: usize,
    /// The next line.
    next: usize,
}

impl<const REACH: usize> MatchedLines<'_, REACH> {
    const DISPARITIES: usize = 2 * REACH + 1;
    const PEAKS: usize = REACH + 1;

    /// The words of memory for lines of `width` columns.
    pub const fn memory_words(width: usize) -> usize {
        (width * (2 * Self::DISPARITIES + Self::PEAKS)).div_ceil(size_of::<u32>())
    }
}

impl<'m, const REACH: usize> MatchedLines<'m, REACH> {
    /// No lines yet, of frames of the size of `search`. `memory` has any content.
    pub fn new(search: &Search, memory: &'m mut [u32]) -> Result<MatchedLines<'m, REACH>, MemoryTooSmall> {
        let (width, height) = (search.width(), search.height());
        let too_small = MemoryTooSmall { needed: Self::memory_words(width), given: memory.len() };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(memory);
        let (disparities, peaks) = bytes.split_at_mut_checked(2 * Self::DISPARITIES * width).ok_or(too_small)?;
        let disparities = bytemuck::try_cast_slice_mut(disparities).map_err(|_| too_small)?;
        let peaks = peaks.get_mut(..Self::PEAKS * width).ok_or(too_small)?;
        Ok(MatchedLines { width, height, disparities, peaks, matched: 0, next: 0 })
    }

    /// Goes on to the next line and returns its index, or `None` after the last: all lines that it needs are there, the last of
    /// them from `matched`. The lines of output have these `lengths`.
    #[cfg_attr(target_arch = "arm", inline(always))]
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
        while self.matched <= (self.height - 1).min(v + REACH) {
            let line = slot_mut(self.disparities, self.matched % Self::DISPARITIES, needed);
            if matched(line, slot_mut(self.peaks, self.matched % Self::PEAKS, needed))?.is_none() {
                return Ok(None);
            }
            self.matched += 1;
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
