//! The lines of a frame under the window of the census transform.

use crate::{Census, Frame, MatchError, ScanlineSource, Search, lines::replicate};

/// A ring of lines, extended to both sides by replication.
#[derive(Debug)]
pub(super) struct CensusWindow<'m> {
    samples: &'m mut [u8],
    /// Pixels to each side, and lines up and down.
    radius: [usize; 2],
    width: usize,
    height: usize,
    /// The next line to be read.
    next: usize,
}

impl Census {
    /// The bytes of the lines under the window, in a frame of `width` columns.
    pub(crate) const fn window_bytes(self, width: usize) -> usize {
        let [rx, ry] = self.radius();
        (2 * ry + 1) * (width + 2 * rx)
    }
}

impl<'m> CensusWindow<'m> {
    /// No lines yet. `samples` has [`Census::window_bytes`] bytes.
    pub fn new(census: Census, search: &Search, samples: &'m mut [u8]) -> CensusWindow<'m> {
        CensusWindow { samples, radius: census.radius(), width: search.width(), height: search.height(), next: 0 }
    }

    /// Reads the lines that the descriptors of line `v` need. `line` is a buffer for a line.
    pub fn read_ahead<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        frame: Frame,
        line: &mut [u8],
        v: usize,
    ) -> Result<(), MatchError<S::Error>> {
        while self.next < self.height && self.next <= v + self.radius[1] {
            source.read_line(frame, self.next, line).map_err(MatchError::Source)?;
            let range = self.stored(self.next);
            let stored = self.samples.get_mut(range).unwrap_or_default();
            replicate(stored.iter_mut(), line, -(self.radius[0] as i32));
            self.next += 1;
        }
        Ok(())
    }

    /// Reads the lines that no descriptor needs any more.
    pub fn read_rest<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        frame: Frame,
        line: &mut [u8],
    ) -> Result<(), MatchError<S::Error>> {
        self.read_ahead(source, frame, line, self.height)
    }

    /// The samples of line `v`, which is under the window.
    pub fn line(&self, v: usize) -> &[u8] {
        self.shifted(v as isize, 0)
    }

    /// Computes the descriptors of line `v`, one plane of bytes after the other.
    #[inline(always)]
    pub fn transform(&self, census: Census, v: usize, descriptors: &mut [u8]) {
        descriptors.fill(0);
        let mut planes = descriptors.chunks_exact_mut(self.width.max(1));
        let mut plane: &mut [u8] = &mut [];
        for (bit, [dx, dy]) in census.offsets().enumerate() {
            if bit % 8 == 0 {
                plane = planes.next().unwrap_or_default();
            }
            let at = |sign: isize| self.shifted(v as isize + sign * dy, sign * dx);
            for ((byte, above), below) in plane.iter_mut().zip(at(1)).zip(at(-1)) {
                *byte |= u8::from(above < below) << (bit % 8);
            }
        }
    }

    /// The samples `dx` columns to the right of each pixel of line `v`, which may lie beyond the frame.
    #[inline(always)]
    fn shifted(&self, v: isize, dx: isize) -> &[u8] {
        // Not `clamp`, which panics if the frame is empty.
        let v = (v.max(0) as usize).min(self.height.saturating_sub(1));
        let start = self.stored(v).start + self.radius[0].wrapping_add_signed(dx);
        self.samples.get(start..start + self.width).unwrap_or_default()
    }

    /// The place where line `v` is stored.
    fn stored(&self, v: usize) -> core::ops::Range<usize> {
        let [rx, ry] = self.radius;
        let span = self.width + 2 * rx;
        let start = v % (2 * ry + 1) * span;
        start..start + span
    }
}
