//! Confidence lines from disparity lines, a few lines later.

use super::table::ConfidenceTable;
use crate::{
    Disparity, MatchError, MemoryTooSmall, Params, Search,
    filters::{MatchedLines, copy_to},
    kernel::{Isa, Portable},
};

/// Computes the confidences of a frame's disparities line by line, from disparity lines as a matcher yields them.
///
/// It keeps eleven lines, and is five lines behind the matcher.
///
/// ```
/// use multiscopic_core::{ConfidenceLines, ConfidenceTable, Frame, Fusion, Matcher, Params, ScanlineSource, SearchConfig, Views};
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
/// const PARAMS: Params = match SEARCH.block_matching(5) {
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
        Ok(ConfidenceLines { isa, table, lines: MatchedLines::new(search, memory)? })
    }

    /// Computes the next line, and returns its index in the frame, or `None` after the last. `matched` computes the next line of
    /// disparities and peak ratios: [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), for the whole frame,
    /// [`SemiGlobalMatcher::next_line_and_peaks`](crate::SemiGlobalMatcher::next_line_and_peaks), or a
    /// [filter](crate::MedianLines) of these.
    ///
    /// # Errors
    /// Those of `matched`, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    #[cfg_attr(target_arch = "arm", inline(always))]
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
