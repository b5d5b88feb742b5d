//! Views in the centre's row of the array, and the centre, by line.

use crate::kernel::Samples;

/// Fills `stored` with the samples of `line` from the coordinate `left` on. Beyond the line, its first and
/// last samples are repeated.
#[inline(always)]
pub(crate) fn replicate<'h>(mut stored: impl Iterator<Item = &'h mut u8>, line: &[u8], left: i32) {
    let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return };
    stored.by_ref().take(left.min(0).unsigned_abs() as usize).for_each(|sample| *sample = first);
    let inside = line.get(left.max(0) as usize..).unwrap_or_default();
    // `zip` alone would take, and drop, one sample more than it fills.
    stored.by_ref().take(inside.len()).zip(inside).for_each(|(sample, &inside)| *sample = inside);
    stored.for_each(|sample| *sample = last);
}

/// A ring buffer of lines, for matches in the same line.
#[derive(Debug)]
pub(super) struct Rows<'m> {
    pub samples: &'m mut [u8],
    /// Bytes of a plane of samples.
    pub plane_bytes: usize,
    /// Columns under the blocks of a disparity line.
    pub span: usize,
    /// Samples in a stored line.
    pub reach: usize,
    /// Lines in the ring.
    pub count: usize,
    /// Samples that a column is compared with.
    pub depth: usize,
    /// True if lines are mirrored, since matches move to the left with the disparity.
    pub mirrored: bool,
    /// The leftmost coordinate in a line, possibly outside the frame.
    pub left: i32,
}

impl Rows<'_> {
    /// The beginning of line `v`.
    fn start(&self, v: i32) -> usize {
        (v as usize).checked_rem(self.count).unwrap_or_default() * self.reach
    }

    /// Stores line `v` of the frame, plane by plane.
    pub fn put<'l>(&mut self, v: i32, planes: impl Iterator<Item = &'l [u8]>) {
        let start = self.start(v);
        for (samples, line) in self.samples.chunks_exact_mut(self.plane_bytes.max(1)).zip(planes) {
            let Some(stored) = samples.get_mut(start..start + self.reach) else { return };
            match self.mirrored {
                true => replicate(stored.iter_mut().rev(), line, self.left),
                false => replicate(stored.iter_mut(), line, self.left),
            }
        }
    }

    /// The samples of a plane that line `v` of the centre is compared with.
    pub fn at(&self, v: i32, plane: usize) -> Samples<'_> {
        let (offset, step) = if self.mirrored { (self.span - 1, -1) } else { (0, 1) };
        let memory = self.samples.get(plane * self.plane_bytes..).unwrap_or_default();
        Samples { memory, start: self.start(v) + offset, step, depth: self.depth }
    }
}

/// A ring buffer of lines in which each column has all of its samples to itself, for matches in the same line with
/// columns between them.
#[derive(Debug)]
pub(super) struct SpreadRows<'m> {
    pub samples: &'m mut [u8],
    /// Bytes of a plane of samples.
    pub plane_bytes: usize,
    /// Columns under the blocks of a disparity line.
    pub span: usize,
    /// Lines in the ring.
    pub count: usize,
    /// Samples that a column is compared with.
    pub depth: usize,
    /// The column of the first pixel's match at the smallest disparity, possibly outside the frame.
    pub left: i32,
    /// The columns to the right at which the match at the next disparity lies.
    pub step: i32,
}

impl SpreadRows<'_> {
    /// The beginning of line `v`.
    fn start(&self, v: i32) -> usize {
        (v as usize).checked_rem(self.count).unwrap_or_default() * self.span * self.depth
    }

    /// Stores line `v` of the frame, plane by plane.
    pub fn put<'l>(&mut self, v: i32, planes: impl Iterator<Item = &'l [u8]>) {
        let start = self.start(v);
        for (samples, line) in self.samples.chunks_exact_mut(self.plane_bytes.max(1)).zip(planes) {
            let Some(stored) = samples.get_mut(start..start + self.span * self.depth) else { return };
            for (index, left) in (0..self.depth).zip(0..) {
                let of_disparity = stored.iter_mut().skip(index).step_by(self.depth.max(1));
                replicate(of_disparity, line, self.left + left * self.step);
            }
        }
    }

    /// The samples of a plane that line `v` of the centre is compared with.
    pub fn at(&self, v: i32, plane: usize) -> Samples<'_> {
        let memory = self.samples.get(plane * self.plane_bytes..).unwrap_or_default();
        Samples { memory, start: self.start(v), step: self.depth as isize, depth: self.depth }
    }
}
