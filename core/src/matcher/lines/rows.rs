//! Lines as they come, or mirrored.

use super::replication::replicate;
use crate::kernel::Samples;

/// A ring of lines, for matches in the same line.
#[derive(Debug)]
pub(super) struct Rows<'m> {
    pub samples: &'m mut [u8],
    /// Columns under the blocks.
    pub span: usize,
    /// Samples in a line.
    pub reach: usize,
    /// Lines in the ring.
    pub count: usize,
    pub depth: usize,
    /// Whether the lines are mirrored: a match's coordinate falls with the disparity.
    pub mirrored: bool,
    /// The leftmost coordinate in a line, maybe outside the frame.
    pub left: i32,
}

impl Rows<'_> {
    fn start(&self, v: i32) -> usize {
        (v as usize).checked_rem(self.count).unwrap_or_default() * self.reach
    }

    /// Takes line `v` of the frame.
    pub fn put(&mut self, v: i32, line: &[u8]) {
        let start = self.start(v);
        let Some(held) = self.samples.get_mut(start..start + self.reach) else { return };
        match self.mirrored {
            true => replicate(held.iter_mut().rev(), line, self.left),
            false => replicate(held.iter_mut(), line, self.left),
        }
    }

    /// The samples that line `v` is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        let (offset, step) = if self.mirrored { (self.span - 1, -1) } else { (0, 1) };
        Samples { memory: self.samples, start: self.start(v) + offset, step, depth: self.depth }
    }
}
