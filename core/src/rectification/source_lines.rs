//! The stored lines of a frame, and the grey values between their pixels.

use super::displacement_grid::{Displacements, Piece, Position, STEPS, Steps};
use crate::{Frame, ScanlineSource};

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
    unread: usize,
    /// The next rectified line, or `None` before the first.
    wanted: Option<usize>,
}

impl<'m> SourceLines<'m> {
    /// No lines of `frame` yet. `ring` has the length of `count` lines.
    pub fn new(frame: Frame, displacements: Displacements<'m>, ring: &'m mut [u8], count: usize) -> SourceLines<'m> {
        SourceLines { frame, displacements, ring, count, next: 0, place: 0, unread: 0, wanted: None }
    }

    /// Forgets all lines.
    pub fn clear(&mut self) {
        (self.next, self.place, self.unread, self.wanted) = (0, 0, 0, None);
    }

    /// True if `v` can be the next rectified line: any line is the first, and the one below is the next.
    pub fn takes(&self, v: usize) -> bool {
        v < self.displacements.grid.height() && self.wanted.is_none_or(|wanted| v == wanted)
    }

    /// Reads what is missing of the lines that line `v` of the rectified frame is interpolated from, and all that are left
    /// for the last. `line` is a buffer for lines that are not stored.
    pub fn read_ahead<S: ScanlineSource>(&mut self, source: &mut S, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        if self.wanted.is_none() {
            let first = if v == 0 { 0 } else { self.displacements.first_source_line(v) };
            (self.next, self.unread, self.wanted) = (first, first, Some(v));
        }
        let width = self.displacements.grid.width();
        let (_, last) = self.displacements.source_lines(v);
        while self.next <= last
            && let Some(stored) = self.ring.get_mut(self.place * width..).and_then(|ring| ring.get_mut(..width))
        {
            source.read_line(self.frame, self.next, stored)?;
            self.next += 1;
            self.unread = self.next;
            self.place = if self.place + 1 < self.count { self.place + 1 } else { 0 };
        }
        let height = self.displacements.grid.height();
        while v + 1 == height && self.unread < height {
            source.read_line(self.frame, self.unread, line)?;
            self.unread += 1;
        }
        Ok(())
    }

    /// Fills `line` with line `v` of the rectified frame, after [`read_ahead`](SourceLines::read_ahead).
    pub fn resample(&mut self, v: usize, line: &mut [u8]) {
        self.wanted = Some(v + 1);
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
