//! The stored lines of a frame, and the grey values between their pixels.

use super::displacement_grid::{Displacements, Position, STEPS};
use crate::{Frame, ScanlineSource};

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

    /// Whether `v` can be the next rectified line: any line is the first, and the one below is the next.
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
        let grid = self.displacements.grid;
        let (mut row, mut above, mut below) = (u32::MAX, &[][..], &[][..]);
        for (column, pixels) in line.chunks_mut(grid.spacing().max(1)).enumerate() {
            let piece = self.displacements.piece(column, v);
            let mut sums = piece.first;
            for (pixel, u) in pixels.iter_mut().zip(column * grid.spacing()..) {
                let position = self.displacements.position_of(sums, piece.shift, u, v);
                sums.right += piece.slope.right;
                sums.down += piece.slope.down;
                if position.row / STEPS != row {
                    row = position.row / STEPS;
                    (above, below) = (self.stored(row as usize), self.stored(row as usize + 1));
                }
                *pixel = between(above, below, position);
            }
        }
    }

    /// Line `v` of the source, which has been stored. For the line below the last stored it is any line: none of it is seen.
    #[inline(always)]
    fn stored(&self, v: usize) -> &[u8] {
        let width = self.displacements.grid.width();
        let after = self.place + v + self.count - self.next;
        let place = if after < self.count { after } else { after - self.count };
        let start = if place < self.count { place * width } else { 0 };
        self.ring.get(start..start + width).unwrap_or_default()
    }
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
    (((STEPS - down) * along(above) + down * along(below) + STEPS * STEPS / 2) / (STEPS * STEPS)) as u8
}
