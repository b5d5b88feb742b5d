//! Lines by column.

use super::replication::replicate;
use crate::kernel::Samples;

/// A stack of samples for each column, for matches in the same column. Newer lines are pushed at the edge, at one end; when
/// it reaches the stack's border, what is still needed moves to the other.
#[derive(Debug)]
pub(super) struct Columns<'m> {
    pub samples: &'m mut [u8],
    /// Samples in a column, with the rounding of the disparities.
    pub stack: usize,
    /// Samples in a column without it.
    pub usable: usize,
    /// How many samples are still needed when one is pushed.
    pub keep: usize,
    pub depth: usize,
    /// Whether newer lines go below older ones: a match's coordinate falls with the disparity.
    pub mirrored: bool,
    /// The first virtual column.
    pub left: i32,
    /// How far below a line the match at the smallest disparity lies.
    pub nearest: i32,
    /// The next virtual line to be pushed.
    pub next: i32,
    /// Past the newest sample, or the newest sample if mirrored.
    pub edge: usize,
}

impl Columns<'_> {
    /// Pushes the next virtual line: the samples of `line`.
    pub fn push(&mut self, line: &[u8]) {
        let newest = self.advance();
        let samples = self.samples.get_mut(newest..).unwrap_or_default();
        replicate(samples.iter_mut().step_by(self.stack.max(1)), line, self.left);
    }

    /// Pushes the next virtual line, which repeats the one before.
    pub fn repeat(&mut self) {
        let newest = self.advance();
        let previous = if self.mirrored { newest + 1 } else { newest.wrapping_sub(1) };
        for stack in self.samples.chunks_exact_mut(self.stack.max(1)) {
            let previous = stack.get(previous).copied();
            if let (Some(previous), Some(newest)) = (previous, stack.get_mut(newest)) {
                *newest = previous;
            }
        }
    }

    /// Goes on to the next virtual line, and returns where in each stack its sample goes.
    fn advance(&mut self) -> usize {
        // Stacks are of the same length, so they are moved all at once. What leaves a stack is no longer needed, and what is at the end
        // that it enters is not needed yet.
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

    /// The samples that line `v`, which may be virtual, is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        // How many lines ago the match at the smallest disparity was pushed.
        let age = (self.next - 1 - (v + self.nearest)) as usize;
        let start = if self.mirrored { self.edge + age } else { (self.edge - 1).wrapping_sub(age) };
        Samples { memory: self.samples, start, step: self.stack as isize, depth: self.depth }
    }
}

/// Moves as many samples as stay within, as the method of slices does, but never panics.
fn copy_within(samples: &mut [u8], from: usize, to: usize) {
    if let Some(end) = samples.len().checked_sub(to).filter(|&end| from <= end) {
        samples.copy_within(from..end, to);
    }
}
