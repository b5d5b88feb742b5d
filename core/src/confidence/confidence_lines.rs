//! Confidence lines from disparity lines, a few lines later.

use super::table::ConfidenceTable;
use crate::{
    Disparity, MatchError, MemoryTooSmall, Params, Search,
    kernel::{Isa, Portable},
};

/// Computes the confidences of a frame's disparities line by line, from disparity lines as a matcher yields them.
///
/// It keeps eleven lines, and is five lines behind the matcher.
///
/// ```
/// use multiscopic_core::{ConfidenceLines, ConfidenceTable, Frame, Fusion, Matcher, Params, ScanlineSource, Views};
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
/// const PARAMS: Params = match Params::new(80, 30, Views::HORIZONTAL, Fusion::Min, 0, 8, 5) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
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
pub struct ConfidenceLines<'m, I = Portable<{ Params::LANES }>> {
    isa: I,
    table: &'m ConfidenceTable,
    width: usize,
    height: usize,
    /// The last [`DISPARITIES`](ConfidenceLines::DISPARITIES) lines.
    disparities: &'m mut [Option<Disparity>],
    /// The last [`PEAKS`](ConfidenceLines::PEAKS) lines.
    peaks: &'m mut [u8],
    /// Lines that the matcher has yielded.
    matched: usize,
    /// The next line.
    next: usize,
}

impl ConfidenceLines<'_> {
    /// How many lines the confidences are behind the disparities.
    pub const LATENCY_LINES: usize = ConfidenceTable::ROWS;
    /// Lines of disparities that are kept.
    const DISPARITIES: usize = 2 * ConfidenceTable::ROWS + 1;
    /// Lines of peak ratios that are kept.
    const PEAKS: usize = ConfidenceTable::ROWS + 1;

    /// The words of memory for a frame of `width` columns: 28 bytes for each.
    pub const fn memory_words(width: usize) -> usize {
        (width * (2 * Self::DISPARITIES + Self::PEAKS)).div_ceil(size_of::<u32>())
    }
}

impl<'m> ConfidenceLines<'m> {
    /// No lines yet, of frames of the size of `search`, with portable instructions.
    ///
    /// `memory` has at least [`memory_words`](ConfidenceLines::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        search: &Search,
        table: &'m ConfidenceTable,
        memory: &'m mut [u32],
    ) -> Result<ConfidenceLines<'m>, MemoryTooSmall> {
        ConfidenceLines::with_isa(Portable, search, table, memory)
    }
}

impl<'m, I: Isa> ConfidenceLines<'m, I> {
    /// [`new`](ConfidenceLines::new) with an instruction set.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn with_isa(
        isa: I,
        search: &Search,
        table: &'m ConfidenceTable,
        memory: &'m mut [u32],
    ) -> Result<ConfidenceLines<'m, I>, MemoryTooSmall> {
        let (width, height) = (search.width(), search.height());
        let too_small = MemoryTooSmall { needed: ConfidenceLines::memory_words(width), given: memory.len() };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(memory);
        let (disparities, peaks) = bytes.split_at_mut_checked(2 * ConfidenceLines::DISPARITIES * width).ok_or(too_small)?;
        let disparities = bytemuck::try_cast_slice_mut(disparities).map_err(|_| too_small)?;
        let peaks = peaks.get_mut(..ConfidenceLines::PEAKS * width).ok_or(too_small)?;
        Ok(ConfidenceLines { isa, table, width, height, disparities, peaks, matched: 0, next: 0 })
    }

    /// Computes the next line, and returns its index in the frame, or `None` after the last. `matched` computes the next line of
    /// disparities and peak ratios: [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), for the whole frame,
    /// or [`SemiGlobalMatcher::next_line_and_peaks`](crate::SemiGlobalMatcher::next_line_and_peaks).
    ///
    /// # Errors
    /// Those of `matched`, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn next_line<E>(
        &mut self,
        mut matched: impl FnMut(&mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, MatchError<E>>,
        disparities: &mut [Option<Disparity>],
        confidences: &mut [u8],
    ) -> Result<Option<usize>, MatchError<E>> {
        let needed = self.width;
        for given in [disparities.len(), confidences.len()] {
            if given != needed {
                return Err(MatchError::OutputLength { needed, given });
            }
        }
        let v = self.next;
        if v >= self.height {
            return Ok(None);
        }
        let last = self.height - 1;
        while self.matched <= last.min(v + ConfidenceLines::LATENCY_LINES) {
            let line = slot_mut(self.disparities, self.matched % ConfidenceLines::DISPARITIES, needed);
            if matched(line, slot_mut(self.peaks, self.matched % ConfidenceLines::PEAKS, needed))?.is_none() {
                return Ok(None);
            }
            self.matched += 1;
        }
        let row = |v: usize| slot(self.disparities, v % ConfidenceLines::DISPARITIES, needed);
        let rows = [v.saturating_sub(ConfidenceTable::ROWS), v, last.min(v + ConfidenceTable::ROWS)].map(row);
        self.table.line_with_isa(self.isa, rows, slot(self.peaks, v % ConfidenceLines::PEAKS, needed), confidences);
        disparities.iter_mut().zip(row(v)).for_each(|(disparity, &matched)| *disparity = matched);
        self.next += 1;
        Ok(Some(v))
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
