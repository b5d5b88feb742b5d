//! Views several baselines to the left or right, by line.

use super::replication::replicate;
use crate::kernel::Samples;

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
