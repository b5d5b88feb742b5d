//! The samples of a view in memory: by line for the centre and for views in its row of the array, by column for the others.

use crate::{kernel::Samples, memory::StackShape};

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

/// A stack of samples for each column, whose matches at ascending disparities follow each other.
///
/// Each line of the view pushes a sample on every stack of its set: lines a match's step apart share a set. From one
/// line of a set to the next, its stacks move to the side with the matches, so that each stays with the pixels whose
/// matches it holds. When the newest samples reach the end of the memory, those still needed move to the other end.
#[derive(Debug)]
pub(super) struct Columns<'m> {
    pub samples: &'m mut [u8],
    /// Bytes of a plane of samples.
    pub plane_bytes: usize,
    pub shape: StackShape,
    /// Samples that a column is compared with.
    pub depth: usize,
    /// True if stacks grow towards their beginning, since matches move up with the disparity.
    pub mirrored: bool,
    /// The leftmost column that gets a sample, possibly outside the frame.
    pub left: i32,
    /// The columns to the right of it, and the lines below a line of the centre, at which the first pixel's match at the
    /// smallest disparity lies.
    pub nearest: (usize, i32),
    /// The first virtual line.
    pub first: i32,
    /// The next virtual line to be pushed.
    pub next: i32,
    /// The number of lines of each set by which the samples have moved.
    pub shifted_lines: usize,
}

impl Columns<'_> {
    /// Pushes the next virtual line, plane by plane.
    pub fn push<'l>(&mut self, planes: impl Iterator<Item = &'l [u8]>) {
        let newest = self.advance();
        let StackShape { stack, columns, .. } = self.shape;
        for (samples, line) in self.samples.chunks_exact_mut(self.plane_bytes.max(1)).zip(planes) {
            let end = newest.wrapping_add(columns.saturating_sub(1) * stack + 1);
            let samples = samples.get_mut(newest..end).unwrap_or_default();
            replicate(samples.iter_mut().step_by(stack.max(1)), line, self.left);
        }
    }

    /// Pushes the next virtual line, which repeats the previous one.
    pub fn repeat(&mut self) {
        let newest = self.advance();
        let previous = self.index(self.next - 2);
        for samples in self.samples.chunks_exact_mut(self.plane_bytes.max(1)) {
            for column in 0..self.shape.columns {
                let offset = column * self.shape.stack;
                let sample = samples.get(previous.wrapping_add(offset)).copied();
                if let (Some(sample), Some(newest)) = (sample, samples.get_mut(newest.wrapping_add(offset))) {
                    *newest = sample;
                }
            }
        }
    }

    /// Goes to the next virtual line, and returns the index of its leftmost sample in a plane.
    fn advance(&mut self) -> usize {
        let StackShape { live, usable, .. } = self.shape;
        if self.set_and_place(self.next) == (0, usable) {
            // All stacks move at once. The samples that thereby cross into others are no longer needed, and they
            // land where nothing is needed yet.
            let places = usable + 1 - live;
            let (from, to) = (self.index_in_set(places), self.index_in_set(0));
            // Two calls, in each of which the compiler sees that it cannot panic.
            match from.checked_sub(to) {
                Some(back) => copy_within(self.samples, back, 0),
                None => copy_within(self.samples, 0, to.wrapping_sub(from)),
            }
            self.shifted_lines += places;
        }
        self.next += 1;
        self.index(self.next - 1)
    }

    /// The set of a virtual line, and the line's place among those of its set.
    fn set_and_place(&self, v: i32) -> (usize, usize) {
        let line = (v - self.first) as usize;
        match self.shape.sets {
            1 => (0, line.wrapping_sub(self.shifted_lines)),
            sets => {
                let place = line.checked_div(sets).unwrap_or_default();
                (line - place * sets, place.wrapping_sub(self.shifted_lines))
            }
        }
    }

    /// The index of the leftmost sample of a virtual line in a plane.
    fn index(&self, v: i32) -> usize {
        let (set, place) = self.set_and_place(v);
        (set * self.shape.set_bytes()).wrapping_add(self.index_in_set(place))
    }

    /// The index of the leftmost sample at a place in a set.
    fn index_in_set(&self, place: usize) -> usize {
        let StackShape { slope, usable, stack, .. } = self.shape;
        let opposite = (usable - 1).wrapping_sub(place);
        let columns = slope.unsigned_abs().wrapping_mul(if slope > 0 { opposite } else { place });
        columns.wrapping_mul(stack).wrapping_add(if self.mirrored { opposite } else { place })
    }

    /// The samples of a plane that line `v` of the centre, which may be virtual, is compared with.
    pub fn at(&self, v: i32, plane: usize) -> Samples<'_> {
        let (column, line) = self.nearest;
        let stack = self.shape.stack;
        let start = self.index(v + line).wrapping_add(column * stack);
        let memory = self.samples.get(plane * self.plane_bytes..).unwrap_or_default();
        Samples { memory, start, step: stack as isize, depth: self.depth }
    }
}

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

/// `slice::copy_within` for as many samples as stay inside. It never panics.
fn copy_within(samples: &mut [u8], from: usize, to: usize) {
    if cfg!(target_os = "none") {
        return copy_in_pieces(samples, from, to);
    }
    if let Some(end) = samples.len().checked_sub(to).filter(|&end| from <= end) {
        samples.copy_within(from..end, to);
    }
}

/// [`copy_within`] piece by piece, none of which overlaps the next: where firmware is optimised for its size, the compiler does not
/// see that `slice::copy_within` cannot panic.
fn copy_in_pieces(mut samples: &mut [u8], from: usize, to: usize) {
    let distance = from.abs_diff(to);
    if distance == 0 {
        return;
    }
    if to < from {
        while let Some((to, from)) = samples.split_at_mut_checked(distance) {
            to.iter_mut().zip(&*from).for_each(|(to, from)| *to = *from);
            samples = from;
        }
        return;
    }
    while let Some((from, to)) = samples.len().checked_sub(distance).and_then(|at| samples.split_at_mut_checked(at)) {
        let moved = from.get(from.len().saturating_sub(distance)..).unwrap_or_default();
        let to = to.get_mut(distance - moved.len()..).unwrap_or_default();
        to.iter_mut().zip(moved).for_each(|(to, from)| *to = *from);
        samples = from;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_copied_as_a_whole() {
        for (from, to) in (0..9).flat_map(|distance| [(distance, 0), (0, distance)]) {
            let (mut found, mut expected) = ([1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 4, 5, 6, 7]);
            copy_in_pieces(&mut found, from, to);
            copy_within(&mut expected, from, to);
            assert_eq!(found, expected, "{from} to {to}");
        }
    }
}
