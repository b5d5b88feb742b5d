//! Views that are searched around a prior, by line.

use crate::{View, kernel::Samples};

/// A ring buffer of lines in which each column has all of its samples to itself: those around the match that the prior
/// foretells.
#[derive(Debug)]
pub(super) struct WarpedRows<'m> {
    /// The samples under a block, and after them `reach` lines of the view.
    pub samples: &'m mut [u8],
    /// The view.
    pub view: View,
    /// Columns under the blocks of a disparity line.
    pub span: usize,
    /// Lines in the ring.
    pub count: usize,
    /// Samples that a column is compared with.
    pub depth: usize,
    /// The leftmost column under the blocks, possibly outside the frame.
    pub left: i32,
    /// Pixels in a line of the view.
    pub width: usize,
    /// The view's last line.
    pub last: i32,
    /// How many lines of the view the matches of a line may lie in.
    pub reach: usize,
    /// The smallest disparity, from the offset.
    pub min_disparity: i16,
    /// The next line of the centre to find matches for.
    pub next: i32,
}

impl WarpedRows<'_> {
    /// Where line `v` of the samples begins.
    fn start(&self, v: i32) -> usize {
        (v as usize).checked_rem(self.count).unwrap_or_default() * self.span * self.depth
    }

    /// Stores line `row` of the view.
    pub fn put(&mut self, row: i32, line: &[u8]) {
        let start = self.count * self.span * self.depth + self.place(row);
        if let Some(stored) = self.samples.get_mut(start..start + self.width)
            && stored.len() == line.len()
        {
            stored.copy_from_slice(line);
        }
    }

    /// Where line `row` of the view begins, among those of the view.
    fn place(&self, row: i32) -> usize {
        (row as usize).checked_rem(self.reach).unwrap_or_default() * self.width
    }

    /// Finds the samples of line `v` of the centre, if that is the next, by the `offsets` of its pixels.
    pub fn warp(&mut self, v: i32, offsets: &[i16]) {
        if v != self.next {
            return;
        }
        self.next += 1;
        let start = self.start(v);
        let &mut WarpedRows { view, span, count, depth, left, width, last, min_disparity, .. } = self;
        let (step, step_down) = view.shift(1);
        let (reach, last_column) = (self.reach, width as i32 - 1);
        let Some((ring, lines)) = self.samples.split_at_mut_checked(count * span * depth) else { return };
        let line = |row: i32| {
            let start = (row.min(last).max(0) as usize).checked_rem(reach).unwrap_or_default() * width;
            lines.get(start..start + width).unwrap_or_default()
        };
        let Some(ring) = ring.get_mut(start..start + span * depth) else { return };
        for (samples, u) in ring.chunks_exact_mut(depth.max(1)).zip(left..) {
            let u = u.min(last_column).max(0);
            let offset = offsets.get(u as usize).copied().unwrap_or_default();
            let (du, dv) = view.shift(offset.wrapping_add(min_disparity));
            let (column, row) = (u + du, v + dv);
            if step_down == 0 {
                let line = line(row);
                match (step, usize::try_from(column).ok().and_then(|start| line.get(start..start + depth))) {
                    (1, Some(line)) => copy(samples, line.iter()),
                    _ => match (
                        step,
                        usize::try_from(column + 1 - depth as i32).ok().and_then(|start| line.get(start..start + depth)),
                    ) {
                        (-1, Some(line)) => copy(samples, line.iter().rev()),
                        _ => copy(samples, (0..).map_while(|k| line.get((column + k * step).min(last_column).max(0) as usize))),
                    },
                }
            } else {
                let sample = |k: i32| line(row + k * step_down).get((column + k * step).min(last_column).max(0) as usize);
                copy(samples, (0..).map_while(sample));
            }
        }
    }

    /// The samples that line `v` of the centre is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        Samples { memory: self.samples, start: self.start(v), step: self.depth as isize, depth: self.depth }
    }
}

/// Copies samples, as many as there are.
#[inline(always)]
fn copy<'l>(samples: &mut [u8], from: impl Iterator<Item = &'l u8>) {
    samples.iter_mut().zip(from).for_each(|(sample, from)| *sample = *from);
}
