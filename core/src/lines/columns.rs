//! Vertical views, by column.

use super::replication::replicate;
use crate::kernel::Samples;

/// A stack of samples for each column, for matches in the same column.
///
/// Each line pushes a sample on every stack. When the edge reaches one end of the stack, the samples still
/// needed move to the other end.
#[derive(Debug)]
pub(super) struct Columns<'m> {
    pub samples: &'m mut [u8],
    /// Bytes of a plane of samples.
    pub plane_bytes: usize,
    /// Bytes of a stack, including those by which disparities are rounded up to whole vectors.
    pub stack: usize,
    /// Samples that a stack can hold.
    pub usable: usize,
    /// Samples of a stack that are still needed when a line is pushed.
    pub keep: usize,
    /// Samples that a column is compared with.
    pub depth: usize,
    /// Whether stacks grow towards their beginning, since matches move up with the disparity.
    pub mirrored: bool,
    /// The first virtual column.
    pub left: i32,
    /// How far below a line of the centre the match at the smallest disparity lies.
    pub nearest: i32,
    /// The next virtual line to be pushed.
    pub next: i32,
    /// One past the newest sample, or the newest sample itself if mirrored.
    pub edge: usize,
}

impl Columns<'_> {
    /// Pushes the next virtual line, plane by plane.
    pub fn push<'l>(&mut self, planes: impl Iterator<Item = &'l [u8]>) {
        let newest = self.advance();
        for (samples, line) in self.samples.chunks_exact_mut(self.plane_bytes.max(1)).zip(planes) {
            let samples = samples.get_mut(newest..).unwrap_or_default();
            replicate(samples.iter_mut().step_by(self.stack.max(1)), line, self.left);
        }
    }

    /// Pushes the next virtual line, which repeats the previous one.
    pub fn repeat(&mut self) {
        let newest = self.advance();
        let previous = if self.mirrored { newest + 1 } else { newest.wrapping_sub(1) };
        let planes = self.samples.chunks_exact_mut(self.plane_bytes.max(1));
        for stack in planes.flat_map(|samples| samples.chunks_exact_mut(self.stack.max(1))) {
            let previous = stack.get(previous).copied();
            if let (Some(previous), Some(newest)) = (previous, stack.get_mut(newest)) {
                *newest = previous;
            }
        }
    }

    /// Goes to the next virtual line, and returns the index of its sample in each stack.
    fn advance(&mut self) -> usize {
        // All stacks move at once. The samples that thereby cross into a neighbouring stack are no longer
        // needed, and they land where nothing is needed yet.
        let moved = self.usable - self.keep;
        match (self.mirrored, self.edge) {
            (false, edge) if edge == self.usable => {
                copy_within(self.samples, moved, 0);
                self.edge = self.keep;
            }
            (true, 0) => {
                copy_within(self.samples, 0, moved);
                self.edge = moved;
            }
            _ => {}
        }
        self.edge = if self.mirrored { self.edge - 1 } else { self.edge + 1 };
        self.next += 1;
        if self.mirrored { self.edge } else { self.edge - 1 }
    }

    /// The samples of a plane that line `v` of the centre, which may be virtual, is compared with.
    pub fn at(&self, v: i32, plane: usize) -> Samples<'_> {
        // The lines pushed since the one of the match at the smallest disparity.
        let age = (self.next - 1 - (v + self.nearest)) as usize;
        let start = if self.mirrored { self.edge + age } else { (self.edge - 1).wrapping_sub(age) };
        let memory = self.samples.get(plane * self.plane_bytes..).unwrap_or_default();
        Samples { memory, start, step: self.stack as isize, depth: self.depth }
    }
}

/// `slice::copy_within` for as many samples as stay inside. It never panics.
fn copy_within(samples: &mut [u8], from: usize, to: usize) {
    if let Some(end) = samples.len().checked_sub(to).filter(|&end| from <= end) {
        samples.copy_within(from..end, to);
    }
}
