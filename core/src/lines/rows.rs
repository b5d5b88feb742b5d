//! Horizontal views and the centre, by line.

use super::replication::replicate;
use crate::kernel::Samples;

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
