//! Lines by column.

use super::Samples;

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
    /// Pushes the next virtual line: a sample for each virtual column from its coordinate and the sample before.
    pub fn push(&mut self, sample: impl Fn(i32, u8) -> u8) {
        let shift = match (self.mirrored, self.edge) {
            (false, edge) if edge == self.usable => Some((edge - self.keep, 0)),
            (true, 0) => Some((0, self.usable - self.keep)),
            _ => None,
        };
        if let Some((from, to)) = shift {
            for stack in self.samples.chunks_exact_mut(self.stack.max(1)) {
                shift_within(stack, from, to, self.keep);
            }
            self.edge = if self.mirrored { to } else { self.keep };
        }
        let (newest, previous) = match self.mirrored {
            false => (self.edge, self.edge.wrapping_sub(1)),
            true => (self.edge - 1, self.edge),
        };
        for (stack, column) in self.samples.chunks_exact_mut(self.stack.max(1)).zip(self.left..) {
            let before = stack.get(previous).copied().unwrap_or_default();
            if let Some(newest) = stack.get_mut(newest) {
                *newest = sample(column, before);
            }
        }
        self.edge = if self.mirrored { self.edge - 1 } else { self.edge + 1 };
        self.next += 1;
    }

    /// The samples that line `v`, which may be virtual, is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        // How many lines ago the match at the smallest disparity was pushed.
        let age = (self.next - 1 - (v + self.nearest)) as usize;
        let start = if self.mirrored { self.edge + age } else { (self.edge - 1).wrapping_sub(age) };
        Samples { samples: self.samples, start, step: self.stack as isize, depth: self.depth }
    }
}

/// Moves `len` samples, as `copy_within` does, but never panics.
fn shift_within(samples: &mut [u8], from: usize, to: usize, len: usize) {
    if from.saturating_add(len) <= samples.len() && to.saturating_add(len) <= samples.len() {
        samples.copy_within(from..from + len, to);
    }
}

/// The sample of `line` at a coordinate that may be outside it.
pub(super) fn replicated(line: &[u8], coordinate: i32) -> u8 {
    let nearest = coordinate.clamp(0, line.len() as i32 - 1);
    line.get(nearest as usize).copied().unwrap_or_default()
}
