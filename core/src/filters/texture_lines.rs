//! The texture filter: where a block has too little texture, a disparity means little.

use core::ops::Range;

use super::{MatchedLines, copy_to};
use crate::{
    BlockMatchingParams, Disparity, Frame, MatchError, MemoryTooSmall, ScanlineSource, View, Views, infallible, kernel::Portable,
    memory::Lender,
};

/// Invalidates disparities around which the centre image has too little texture, line by line, as a matcher yields them.
///
/// The texture is the sum over the block of [`BlockMatchingParams`] of the slopes of grey, each the magnitude of a 3 x 3 Sobel
/// derivative and at most 31: along rows for views to the left and right, along columns for those above and below, and for
/// others the greater of the two. Beyond the borders the pixels there are repeated. With views to the left or right alone this
/// is the texture of OpenCV's StereoBM, except at the borders. It is one line behind the matcher, whose lines of the centre it
/// sees on their way.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Frame, Fusion, Matcher, ScanlineSource, SearchConfig, TextureLines, Views, valid};
///
/// /// Stripes, and blank columns from 40 on, seen two pixels further to each side.
/// struct Wall;
///
/// impl ScanlineSource for Wall {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = if let Frame::View(view) = frame { view.shift(2).0 } else { 0 };
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = if u - shift < 40 { ((u - shift) * (u - shift) % 97) as u8 } else { 60 };
///         }
///         Ok(())
///     }
/// }
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(80, 30) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(5));
/// let mut memory = [0; PARAMS.memory_words()];
/// let mut matcher = Matcher::new(&PARAMS, &mut memory)?;
/// let mut memory = [0; TextureLines::memory_words(&PARAMS)];
/// let mut lines = TextureLines::new(&PARAMS, 100, &mut memory)?;
/// let (mut disparities, mut peaks) = ([None; PARAMS.width()], [0; PARAMS.width()]);
/// while let Some(_v) = lines.next_line(
///     |center, line, _peaks| matcher.next_line(&mut center.observe(&mut Wall), line),
///     &mut disparities,
///     &mut peaks,
/// )? {
///     assert_eq!((disparities[20].map(f32::from), disparities[60]), (Some(2.0), None));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct TextureLines<'m> {
    threshold: u32,
    center: CenterLines<'m>,
    lines: MatchedLines<'m, { TextureLines::LATENCY_LINES }>,
}

/// The slopes of the lines of the centre that a matcher reads: [`TextureLines`].
#[derive(Debug)]
pub struct CenterLines<'m> {
    width: usize,
    height: usize,
    /// The height of the block.
    block_size: usize,
    /// The views, in whose directions slopes count.
    views: Views,
    /// The last two lines of grey.
    gray: [&'m mut [u8]; 2],
    /// The slopes of the last lines, two more than the block has.
    slopes: &'m mut [u8],
    /// The slopes of each column, summed down the block.
    columns: &'m mut [u16],
}

/// A source, with its lines of the centre seen by a [`TextureLines`].
#[derive(Debug)]
pub struct ObservedSource<'c, 'm, S> {
    center: &'c mut CenterLines<'m>,
    source: S,
}

/// Slopes count up to this: the default of OpenCV's `preFilterCap`.
const MAX_SLOPE: u32 = 31;

impl TextureLines<'_> {
    /// The number of lines by which it is behind the matcher.
    pub const LATENCY_LINES: usize = 1;

    /// The words of memory for these parameters: a byte for each column and line of the block, and 14 for each column.
    pub const fn memory_words(params: &BlockMatchingParams) -> usize {
        let lines = MatchedLines::<{ TextureLines::LATENCY_LINES }>::memory_words(params.width());
        lines + CenterLines::memory_words(params)
    }
}

impl<'m> TextureLines<'m> {
    /// No lines yet, of a whole frame that is matched with these parameters. `threshold` is the least texture that is enough.
    ///
    /// `memory` has at least [`memory_words`](TextureLines::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &BlockMatchingParams, threshold: u32, memory: &'m mut [u32]) -> Result<TextureLines<'m>, MemoryTooSmall> {
        let too_small = MemoryTooSmall { needed: TextureLines::memory_words(params), given: memory.len() };
        let (center, lines) = memory.split_at_mut_checked(CenterLines::memory_words(params)).ok_or(too_small)?;
        let lines = MatchedLines::new(params.search(), lines).map_err(|_| too_small)?;
        Ok(TextureLines { threshold, center: CenterLines::new(params, center)?, lines })
    }

    /// Computes the next line, and returns its index in the frame, or `None` after the last. `matched` computes the next line of
    /// disparities and peak ratios from a source that is [seen](CenterLines::observe):
    /// [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), with the same parameters and for the whole frame.
    ///
    /// # Errors
    /// Those of `matched`, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    pub fn next_line<E>(
        &mut self,
        mut matched: impl FnMut(&mut CenterLines<'m>, &mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, MatchError<E>>,
        disparities: &mut [Option<Disparity>],
        peaks: &mut [u8],
    ) -> Result<Option<usize>, MatchError<E>> {
        let TextureLines { threshold, center, lines } = self;
        let lengths = [disparities.len(), peaks.len()];
        let Some(v) = lines.advance(|line, peaks| matched(center, line, peaks), lengths)? else { return Ok(None) };
        center.enter_line(v);
        let (radius, last) = (center.block_size as isize / 2, center.width as isize - 1);
        let column = |u: isize| u32::from(center.columns.get(u.max(0).min(last) as usize).copied().unwrap_or_default());
        // The block before the first.
        let mut texture: u32 = (-radius - 1..radius).map(column).sum();
        for ((u, pixel), &matched) in (0..).zip(disparities).zip(lines.disparities(v)) {
            texture = texture + column(u + radius) - column(u - radius - 1);
            *pixel = matched.filter(|_| texture >= *threshold);
        }
        copy_to(peaks, lines.peaks(v));
        Ok(Some(v))
    }
}

impl<'m> CenterLines<'m> {
    /// The bytes of a line of grey, of slopes and of column sums.
    const fn bytes(params: &BlockMatchingParams) -> [usize; 3] {
        // Besides the lines of the block, the one that leaves it, and the last of the frame, which comes with the one before.
        [params.width(), (params.block_size() + 2) * params.width(), 2 * params.width()]
    }

    /// The words of memory for these parameters.
    const fn memory_words(params: &BlockMatchingParams) -> usize {
        let [gray, slopes, columns] = CenterLines::bytes(params);
        2 * infallible::div_ceil(gray, 4) + infallible::div_ceil(slopes, 4) + infallible::div_ceil(columns, 4)
    }

    fn new(params: &BlockMatchingParams, memory: &'m mut [u32]) -> Result<CenterLines<'m>, MemoryTooSmall> {
        let mut lender = Lender::new::<Portable<1>>(memory, CenterLines::memory_words(params))?;
        let [gray, slopes, columns] = CenterLines::bytes(params);
        Ok(CenterLines {
            width: params.width(),
            height: params.height(),
            block_size: params.block_size(),
            views: params.views(),
            gray: [lender.bytes(gray)?, lender.bytes(gray)?],
            slopes: lender.bytes(slopes)?,
            columns: infallible::cast_mut(lender.bytes(columns)?),
        })
    }

    /// A source whose lines of the centre pass here.
    pub fn observe<S: ScanlineSource>(&mut self, source: S) -> ObservedSource<'_, 'm, S> {
        ObservedSource { center: self, source }
    }

    /// Takes line `v`, the next one.
    fn take(&mut self, v: usize, line: &[u8]) {
        if v == 0 {
            self.gray.iter_mut().for_each(|gray| copy_to(gray, line));
        } else {
            self.compute_slopes(v - 1, line);
            self.gray.swap(0, 1);
            copy_to(self.gray[1], line);
        }
        if v + 1 == self.height {
            self.compute_slopes(v, line);
        }
    }

    /// The slopes of line `v`, between the lines that are kept and the one `below`.
    fn compute_slopes(&mut self, v: usize, below: &[u8]) {
        let place = self.place(v);
        let [above, here] = &self.gray;
        slopes([above, here, below], self.views, self.slopes.get_mut(place).unwrap_or_default());
    }

    /// Moves the column sums to the blocks around line `v`, the next one.
    fn enter_line(&mut self, v: usize) {
        let radius = self.block_size / 2;
        if v == 0 {
            self.columns.fill(0);
            for row in 0..self.block_size {
                self.add(row.saturating_sub(radius), u16::wrapping_add);
            }
        } else {
            self.add(v + radius, u16::wrapping_add);
            self.add((v - 1).saturating_sub(radius), u16::wrapping_sub);
        }
    }

    /// Adds the slopes of line `v`, or of the last if the frame is not as high, to the column sums.
    fn add(&mut self, v: usize, sum: fn(u16, u16) -> u16) {
        let slopes = self.slopes.get(self.place(v.min(self.height - 1))).unwrap_or_default();
        for (column, &slope) in self.columns.iter_mut().zip(slopes) {
            *column = sum(*column, slope.into());
        }
    }

    /// The place of the slopes of line `v`.
    fn place(&self, v: usize) -> Range<usize> {
        let start = v % (self.block_size + 2) * self.width;
        start..start + self.width
    }
}

/// The slopes of grey of the middle one of three lines, from 0 to 31, by which [`TextureLines`] measures texture for these views.
pub fn slopes(rows: [&[u8]; 3], views: Views, slopes: &mut [u8]) {
    let [along_rows, along_columns] =
        [View::right as fn(View) -> i8, View::down].map(|offset| views.iter().any(|view| offset(view) != 0));
    let last = slopes.len().saturating_sub(1);
    let column = |u: usize| rows.map(|row| i32::from(row.get(last.min(u)).copied().unwrap_or_default()));
    let weighted = |[a, b, c]: [i32; 3]| a + 2 * b + c;
    let of = |derivative: i32, counts| if counts { derivative.unsigned_abs().min(MAX_SLOPE) } else { 0 };
    let mut columns = [[0; 3], column(0), column(0)];
    for (u, slope) in slopes.iter_mut().enumerate() {
        columns = [columns[1], columns[2], column(u + 1)];
        let across = weighted(columns[2]) - weighted(columns[0]);
        let down = weighted(columns.map(|[above, _, below]| below - above));
        *slope = of(across, along_rows).max(of(down, along_columns)) as u8;
    }
}

impl<S: ScanlineSource> ScanlineSource for ObservedSource<'_, '_, S> {
    type Error = S::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        self.source.read_line(frame, v, line)?;
        if frame == Frame::Center {
            self.center.take(v, line);
        }
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), S::Error> {
        self.source.read_prior(v, line)
    }
}
