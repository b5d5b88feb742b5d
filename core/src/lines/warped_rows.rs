//! Views that are searched around a prior, by line.

use crate::{Disparity, View, kernel::Samples, params::Prior};

/// A ring buffer of lines in which each column has all of its samples to itself: those around the match that the prior
/// foretells, each between two of the view's.
#[derive(Debug)]
pub(super) struct WarpedRows<'m> {
    /// The samples under a block, and after them `reach` lines of the view.
    pub samples: &'m mut [u8],
    /// The view.
    pub view: View,
    /// The prior.
    pub prior: Prior,
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

    /// Finds the samples of line `v` of the centre, if that is the next, by the `steps` of its pixels' priors.
    pub fn warp(&mut self, v: i32, steps: &[i16]) {
        if v != self.next {
            return;
        }
        self.next += 1;
        let start = self.start(v);
        let &mut WarpedRows { view, prior, span, count, depth, left, width, last, reach, min_disparity, .. } = self;
        let ((step, step_down), last_column) = (view.shift(1), width as i32 - 1);
        let Some((ring, lines)) = self.samples.split_at_mut_checked(count * span * depth) else { return };
        let line = |row: i32| {
            let start = (row.min(last).max(0) as usize).checked_rem(reach).unwrap_or_default() * width;
            lines.get(start..start + width).unwrap_or_default()
        };
        let Some(ring) = ring.get_mut(start..start + span * depth) else { return };
        for (samples, u) in ring.chunks_exact_mut(depth.max(1)).zip(left..) {
            let u = u.min(last_column).max(0);
            let (offset, rest) = prior.offset(steps.get(u as usize).copied().unwrap_or_default());
            let (du, dv) = view.shift(offset.wrapping_add(min_disparity));
            let (column, row) = (u + du, v + dv);
            let here = line(row);
            let inside = |first: i32| usize::try_from(first).ok().and_then(|first| here.get(first..first + depth + 1));
            let forward = if step == 1 { inside(column) } else { None };
            let backward = if step == -1 { inside(column - depth as i32) } else { None };
            match (forward, backward) {
                (Some(line), _) if step_down == 0 => blend(samples, line.iter(), rest),
                (_, Some(line)) if step_down == 0 => blend(samples, line.iter().rev(), rest),
                _ => {
                    let sample = |k: i32| line(row + k * step_down).get((column + k * step).min(last_column).max(0) as usize);
                    blend(samples, (0..).map_while(sample), rest);
                }
            }
        }
    }

    /// The samples that line `v` of the centre is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        Samples { memory: self.samples, start: self.start(v), step: self.depth as isize, depth: self.depth }
    }
}

/// Fills samples with those between neighbours of `from`, of which there is one more, `rest` steps from each to the next.
#[inline(always)]
fn blend<'l>(samples: &mut [u8], mut from: impl Iterator<Item = &'l u8>, rest: u8) {
    let steps = Disparity::STEPS as u32;
    let Some(mut near) = from.next().copied().map(u32::from) else { return };
    for (sample, far) in samples.iter_mut().zip(from) {
        let far = u32::from(*far);
        *sample = ((near * (steps - u32::from(rest)) + far * u32::from(rest) + steps / 2) / steps) as u8;
        near = far;
    }
}
