//! The source of rectified lines.

use core::{error, fmt, iter, mem};

use super::{
    Rectification,
    displacement_grid::{Displacements, Piece, Position, STEPS, Steps},
};
use crate::{Disparity, Frame, MemoryTooSmall, Rewind, ScanlineSource, Views, infallible};

/// Bits of the sums of a [`Piece`] below a pixel, and the sum of a pixel.
const PIXEL_BITS: u32 = Piece::BITS + STEPS.trailing_zeros();
const PIXEL: i32 = 1 << PIXEL_BITS;

/// A ring buffer of the lines of a frame that a camera took.
#[derive(Debug)]
pub(super) struct SourceLines<'m> {
    pub frame: Frame,
    displacements: Displacements<'m>,
    /// The stored lines.
    ring: &'m mut [u8],
    /// The lines that fit the ring.
    count: usize,
    /// The next line to be stored, and its place among those of the ring.
    next: usize,
    place: usize,
    /// The next line to be read: later than the next to be stored if lines at the bottom are not needed.
    next_unread: usize,
    /// The next rectified line, or `None` before the first.
    next_rectified: Option<usize>,
}

impl<'m> SourceLines<'m> {
    /// No lines of `frame` yet. `ring` has the length of `count` lines.
    pub fn new(frame: Frame, displacements: Displacements<'m>, ring: &'m mut [u8], count: usize) -> SourceLines<'m> {
        SourceLines { frame, displacements, ring, count, next: 0, place: 0, next_unread: 0, next_rectified: None }
    }

    /// Forgets all lines.
    pub fn clear(&mut self) {
        (self.next, self.place, self.next_unread, self.next_rectified) = (0, 0, 0, None);
    }

    /// True if `v` can be the next rectified line: any line is the first, and the one below is the next.
    pub fn takes(&self, v: usize) -> bool {
        v < self.displacements.grid.height() && self.next_rectified.is_none_or(|wanted| v == wanted)
    }

    /// Reads what is missing of the lines that line `v` of the rectified frame is interpolated from, and all that are left
    /// for the last. `line` is a buffer for lines that are not stored.
    pub fn read_ahead<S: ScanlineSource>(&mut self, source: &mut S, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        if self.next_rectified.is_none() {
            let first = if v == 0 { 0 } else { self.displacements.first_source_line(v) };
            (self.next, self.next_unread, self.next_rectified) = (first, first, Some(v));
        }
        let width = self.displacements.grid.width();
        let (_, last) = self.displacements.source_lines(v);
        while self.next <= last
            && let Some(stored) = self.ring.get_mut(self.place * width..).and_then(|ring| ring.get_mut(..width))
        {
            source.read_line(self.frame, self.next, stored)?;
            self.next += 1;
            self.next_unread = self.next;
            self.place = if self.place + 1 < self.count { self.place + 1 } else { 0 };
        }
        let height = self.displacements.grid.height();
        while v + 1 == height && self.next_unread < height {
            source.read_line(self.frame, self.next_unread, line)?;
            self.next_unread += 1;
        }
        Ok(())
    }

    /// Fills `line` with line `v` of the rectified frame, after [`read_ahead`](SourceLines::read_ahead).
    pub fn resample(&mut self, v: usize, line: &mut [u8]) {
        self.next_rectified = Some(v + 1);
        let spacing = self.displacements.grid.spacing();
        let mut columns = self.displacements.columns_between_rows(v);
        let Some(mut left) = columns.next() else { return };
        let (mut u, mut pair) = (0, LinePair::NONE);
        for (pixels, right) in line.chunks_mut(spacing.max(1)).zip(columns) {
            let piece = self.displacements.piece_between(left, right);
            if !self.resample_inside(&piece, (u, v), pixels, &mut pair) {
                self.resample_anywhere(&piece, (u, v), pixels);
            }
            left = right;
            u += spacing;
        }
    }

    /// Fills `pixels`, of which the first is pixel `(u, v)`, if all are found between pixels of the source, from left to right.
    /// Others may be found beyond its borders: each is limited to the frame, which takes twice as long.
    #[inline(always)]
    fn resample_inside<'a>(&'a self, piece: &Piece, (u, v): (usize, usize), pixels: &mut [u8], pair: &mut LinePair<'a>) -> bool {
        let grid = self.displacements.grid;
        let (after, Steps { mut right, mut down }) = (pixels.len() as i32 - 1, piece.first);
        let slope = Steps { right: piece.slope.right + PIXEL, down: piece.slope.down };
        let whole = |pixel: usize, sum: i32| pixel as i32 + (sum >> PIXEL_BITS);
        // Positions go up or down, so the extremes are at the ends.
        let (left, last) = (whole(u, right), whole(u, right + after * slope.right));
        let is_inside = |sum: i32| (whole(v, sum) as usize) < grid.height() - 1;
        if slope.right <= 0 || left < 0 || last >= grid.width() as i32 - 1 {
            return false;
        }
        if !is_inside(down) || !is_inside(down + after * slope.down) {
            return false;
        }
        right &= PIXEL - 1;
        let mut rest = pixels;
        while !rest.is_empty() {
            // The pixels between the same two lines.
            let below = down & (PIXEL - 1);
            let room = if slope.down < 0 { below } else { PIXEL - 1 - below };
            let count = (room as u32).checked_div(slope.down.unsigned_abs()).map_or(usize::MAX, |count| count as usize + 1);
            let (between, others) = rest.split_at_mut(count.min(rest.len()));
            let row = whole(v, down) as usize;
            if pair.row != row {
                let (Some(above), Some(below)) = (self.stored(row), self.stored(row + 1)) else { return false };
                *pair = LinePair { row, above, below };
            }
            let (Some(above), Some(below)) = (pair.above.get(left as usize..), pair.below.get(left as usize..)) else {
                return false;
            };
            let count = between.len() as i32;
            resample_between(above, below, Steps { right, down }, slope, between);
            right += count * slope.right;
            down += count * slope.down;
            rest = others;
        }
        true
    }

    /// Fills `pixels`, of which the first is pixel `(u, v)`.
    #[inline(never)]
    fn resample_anywhere(&self, piece: &Piece, (u, v): (usize, usize), pixels: &mut [u8]) {
        let (mut row, mut above, mut below) = (u32::MAX, &[][..], &[][..]);
        let mut sums = piece.first;
        for (pixel, u) in pixels.iter_mut().zip(u..) {
            let position = self.displacements.position_of(sums, u, v);
            sums.right += piece.slope.right;
            sums.down += piece.slope.down;
            if position.row / STEPS != row {
                row = position.row / STEPS;
                let stored = |row: u32| self.stored(row as usize).unwrap_or_default();
                (above, below) = (stored(row), stored(row + 1));
            }
            *pixel = between(above, below, position);
        }
    }

    /// Line `v` of the source, which has been stored. For the line below the last stored it is any line: none of it is seen.
    #[inline(always)]
    fn stored(&self, v: usize) -> Option<&[u8]> {
        let width = self.displacements.grid.width();
        let after = self.place + v + self.count - self.next;
        let place = if after < self.count { after } else { after - self.count };
        self.ring.get(place * width..)?.get(..width)
    }
}

/// A line of the source and the one below it.
struct LinePair<'a> {
    row: usize,
    above: &'a [u8],
    below: &'a [u8],
}

impl LinePair<'_> {
    /// No lines: there are fewer rows.
    const NONE: LinePair<'static> = LinePair { row: usize::MAX, above: &[], below: &[] };
}

/// Fills `pixels` from two lines. Their sums are those of the first pixel, to the right of the first pixel of the lines, and
/// grow by `slope`.
// A function of its own, so that all of it stays in registers.
#[inline(never)]
fn resample_between(above: &[u8], below: &[u8], mut sums: Steps, slope: Steps, pixels: &mut [u8]) {
    // One check for each pixel suffices for both lines.
    let Some(below) = below.get(..above.len()) else { return };
    for pixel in pixels {
        let left = (sums.right as u32 >> PIXEL_BITS) as usize;
        let (Some(&above), Some(&below)) = (pair_at(above, left), pair_at(below, left)) else { return };
        // Both lines in one word, the upper one's in the lower half: 64 times 255 fits either half.
        let four = u32::from(u16::from_le_bytes(above)) | u32::from(u16::from_le_bytes(below)) << 16;
        let (lefts, rights) = (four & 0x00FF_00FF, four >> 8 & 0x00FF_00FF);
        let fraction = |sum: i32| (sum >> Piece::BITS) as u32 % STEPS;
        let (p, q) = (fraction(sums.right), fraction(sums.down) as i32);
        let along = (STEPS - p) * lefts + p * rights;
        let (above, below) = (i32::from(along as i16), along as i32 >> 16);
        *pixel = rounded(((STEPS as i32 - q) * above + q * below) as u32);
        sums.right += slope.right;
        sums.down += slope.down;
    }
}

/// The pixels `column` and `column + 1`.
#[inline(always)]
fn pair_at(line: &[u8], column: usize) -> Option<&[u8; 2]> {
    line.get(column..column + 2)?.first_chunk()
}

/// The grey value at a position in or between two lines.
#[inline(always)]
fn between(above: &[u8], below: &[u8], Position { column, row }: Position) -> u8 {
    let (left, right) = (column / STEPS, column.div_ceil(STEPS));
    let (across, down) = (column % STEPS, row % STEPS);
    let along = |line: &[u8]| {
        let gray = |column: u32| u32::from(line.get(column as usize).copied().unwrap_or_default());
        (STEPS - across) * gray(left) + across * gray(right)
    };
    rounded((STEPS - down) * along(above) + down * along(below))
}

/// The grey value of a sum of grey values whose weights are `STEPS * STEPS` together.
#[inline(always)]
fn rounded(sum: u32) -> u8 {
    ((sum + STEPS * STEPS / 2) / (STEPS * STEPS)) as u8
}

/// The lines of another source, rectified. [`Rectification`] defines the grey values.
///
/// The other source is asked for each line of its frames once, in ascending order, and no earlier than a rectified line
/// needs it; for the rest of a frame with the last rectified line. The caller lends the memory for the lines that lie
/// between those that a rectified line needs. Lines of the [prior](ScanlineSource::read_prior) are handed on as they are.
///
/// ```
/// use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification, Rectified, ScanlineSource, Views};
///
/// /// A horizontal edge, but the camera was tilted: the edge is half a line lower with each column.
/// struct TiltedEdge;
///
/// impl ScanlineSource for TiltedEdge {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, _frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = (100 + 20 * (2 * v as i32 - u)).clamp(0, 200) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const GRID: DisplacementGrid = DisplacementGrid::new(8, 6, 8).unwrap();
/// /// None at the left, four lines down at column 8.
/// const TILT: [Displacement; GRID.nodes()] = {
///     let (straight, tilted) = (Displacement::ZERO, Displacement { right: 0, down: 4 * 64 });
///     [straight, tilted, straight, tilted]
/// };
/// const RECTIFICATION: Rectification = match Rectification::new(GRID, &TILT, &[]) {
///     Ok(rectification) => rectification,
///     Err(_) => panic!("a displacement is missing"),
/// };
/// // Line 0 is made of the lines 0 to 4 of the source: from 0 at column 0 to 3.5 at column 7.
/// assert_eq!(RECTIFICATION.stored_lines(Frame::Center), 5);
///
/// let mut memory = [0; RECTIFICATION.memory(Views::NONE).words()];
/// let mut rectified = Rectified::new(TiltedEdge, &RECTIFICATION, Views::NONE, &mut memory)?;
/// let mut line = [0; 8];
/// rectified.read_line(Frame::Center, 0, &mut line)?;
/// assert_eq!(line, [100; 8]);
/// rectified.read_line(Frame::Center, 1, &mut line)?;
/// assert_eq!(line, [140; 8]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Rectified<'m, S> {
    source: S,
    width: usize,
    /// The centre, and the views.
    frames: [Option<SourceLines<'m>>; 1 + Views::MAX],
}

impl<'m, S> Rectified<'m, S> {
    /// Rectifies the centre and `views` of `source`.
    ///
    /// `memory` has at least the [`words`](crate::Memory::words) that [`Rectification::memory`] states for `views`, with any
    /// content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        source: S,
        rectification: &Rectification<'m>,
        views: Views,
        memory: &'m mut [u32],
    ) -> Result<Rectified<'m, S>, MemoryTooSmall> {
        let width = rectification.grid().width();
        let too_small = MemoryTooSmall { needed: rectification.memory(views).words(), given: memory.len() };
        let mut rest: &'m mut [u8] = infallible::cast_mut(memory);
        let mut frames = [const { None }; 1 + Views::MAX];
        let names = iter::once(Frame::Center).chain(views.iter().map(Frame::View));
        for (lines, frame) in frames.iter_mut().zip(names) {
            let count = rectification.stored_lines(frame);
            let (ring, others) = mem::take(&mut rest).split_at_mut_checked(count * width).ok_or(too_small)?;
            rest = others;
            *lines = Some(SourceLines::new(frame, rectification.displacements(frame), ring, count));
        }
        Ok(Rectified { source, width, frames })
    }
}

impl<S: ScanlineSource> ScanlineSource for Rectified<'_, S> {
    type Error = RectifiedError<S::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        if line.len() != self.width {
            return Err(RectifiedError::LineLength { needed: self.width, given: line.len() });
        }
        let lines = self.frames.iter_mut().flatten().find(|lines| lines.frame == frame);
        let Some(lines) = lines.filter(|lines| lines.takes(v)) else {
            return Err(RectifiedError::NotNext { frame, v });
        };
        lines.read_ahead(&mut self.source, v, line).map_err(RectifiedError::Source)?;
        lines.resample(v, line);
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Self::Error> {
        self.source.read_prior(v, line).map_err(RectifiedError::Source)
    }
}

impl<S: Rewind> Rewind for Rectified<'_, S> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        self.source.rewind().map_err(RectifiedError::Source)?;
        self.frames.iter_mut().flatten().for_each(SourceLines::clear);
        Ok(())
    }
}

/// The reason why a line could not be rectified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RectifiedError<E> {
    /// The source of the lines to rectify failed.
    Source(E),
    /// The line is not the one below the last of the frame, is outside the frame, or the frame is not one of those that are
    /// rectified.
    NotNext {
        /// The frame.
        frame: Frame,
        /// The line.
        v: usize,
    },
    /// The slice for the line has the wrong length.
    LineLength {
        /// Pixels needed: the frame's width.
        needed: usize,
        /// Pixels given.
        given: usize,
    },
}

impl<E: fmt::Display> fmt::Display for RectifiedError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RectifiedError::Source(error) => error.fmt(f),
            RectifiedError::NotNext { frame, v } => write!(f, "line {v} of frame {frame} is not the next to be rectified"),
            RectifiedError::LineLength { needed, given } => write!(f, "a line has {needed} pixels, {given} were given"),
        }
    }
}

impl<E: error::Error> error::Error for RectifiedError<E> {}
