//! Views that are searched around a prior, by line.

use crate::{
    Disparity, MatchError, ScanlineSource, View,
    kernel::Samples,
    params::{Prior, PriorLine},
};

/// A ring buffer of the disparities around which is searched.
#[derive(Debug)]
pub(crate) struct PriorLines<'m> {
    prior: Prior,
    /// From the line that is computed to the lowest under its blocks, without what is out of the prior's range.
    lines: &'m mut [Option<Disparity>],
    /// The steps of the line that was read last, one for each pixel whether it has a prior or not.
    steps: &'m mut [i16],
    /// The next line to be read.
    next: usize,
}

impl<'m> PriorLines<'m> {
    /// No lines yet; the first to be read is `next`. `lines` has room for whole lines of as many pixels as `steps` has.
    pub fn new(prior: Prior, lines: &'m mut [Option<Disparity>], steps: &'m mut [i16], next: usize) -> PriorLines<'m> {
        PriorLines { prior, lines, steps, next }
    }

    /// Reads the lines up to `v`.
    pub fn read_ahead<S: ScanlineSource>(&mut self, source: &mut S, v: usize) -> Result<(), MatchError<S::Error>> {
        while self.next <= v {
            let line = place(self.next, self.lines.len(), self.steps.len());
            let Some(line) = self.lines.get_mut(line) else { return Ok(()) };
            source.read_prior(self.next, line).map_err(MatchError::Source)?;
            let mut last = self.prior.nearest_to_zero();
            for (steps, pixel) in self.steps.iter_mut().zip(line) {
                *pixel = pixel.filter(|&d| self.prior.contains(d));
                last = pixel.map_or(last, Disparity::to_bits);
                *steps = last;
            }
            self.next += 1;
        }
        Ok(())
    }

    /// The steps of each pixel of the line that was read last: its own prior, or that of the last pixel to its left which
    /// has one, or the nearest to 0 that there may be.
    pub fn steps(&self) -> &[i16] {
        self.steps
    }

    /// Line `v`.
    pub fn line(&self, v: usize) -> PriorLine<'_> {
        let line = place(v, self.lines.len(), self.steps.len());
        PriorLine { prior: self.prior, pixels: self.lines.get(line).unwrap_or_default() }
    }
}

/// The place of line `v` of `width` pixels in a ring of `pixels`.
fn place(v: usize, pixels: usize, width: usize) -> core::ops::Range<usize> {
    let lines = pixels.checked_div(width).unwrap_or_default();
    let start = v.checked_rem(lines).unwrap_or_default() * width;
    start..start + width
}

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
    /// The number of lines of the view in which the matches of a line may lie.
    pub reach: usize,
    /// The smallest disparity, from the offset.
    pub min_disparity: i16,
    /// The next line of the centre to find matches for.
    pub next: i32,
}

impl WarpedRows<'_> {
    /// The beginning of line `v` of the samples.
    fn start(&self, v: i32) -> usize {
        (v as usize).checked_rem(self.count).unwrap_or_default() * self.span * self.depth
    }

    /// Stores line `row` of the view.
    pub fn put(&mut self, row: i32, line: &[u8]) {
        let start = self.count * self.span * self.depth + self.place(row);
        let is_mirrored = self.is_mirrored();
        let Some(stored) = self.samples.get_mut(start..start + self.width) else { return };
        match is_mirrored {
            true => stored.iter_mut().rev().zip(line).for_each(|(stored, sample)| *stored = *sample),
            false => stored.iter_mut().zip(line).for_each(|(stored, sample)| *stored = *sample),
        }
    }

    /// True if lines of the view are stored from right to left, so that the samples of a pixel's matches at ascending
    /// disparities are contiguous.
    fn is_mirrored(&self) -> bool {
        self.view.shift(1) == (-1, 0)
    }

    /// The beginning of line `row` of the view, among those of the view.
    fn place(&self, row: i32) -> usize {
        (row as usize).checked_rem(self.reach).unwrap_or_default() * self.width
    }

    /// Finds the samples of line `v` of the centre, if that is the next, by the `steps` of its pixels' priors.
    pub fn warp(&mut self, v: i32, steps: &[i16]) {
        if v != self.next {
            return;
        }
        self.next += 1;
        match self.view.shift(1) {
            (-1 | 1, 0) => self.warp_contiguous(v, steps),
            _ => self.warp_spread(v, steps),
        }
    }

    /// [`warp`](WarpedRows::warp) where the samples of a pixel's matches are contiguous.
    fn warp_contiguous(&mut self, v: i32, steps: &[i16]) {
        let (start, row, is_mirrored) = (self.start(v), self.place(v.min(self.last).max(0)), self.is_mirrored());
        let &mut WarpedRows { prior, span, count, depth, left, width, min_disparity, .. } = self;
        let last_column = width as i32 - 1;
        let Some((ring, lines)) = self.samples.split_at_mut_checked(count * span * depth) else { return };
        let Some(line) = lines.get(row..row + width) else { return };
        let Some(ring) = ring.get_mut(start..start + span * depth) else { return };
        // Columns beyond the frame have the samples of the outermost ones inside.
        let beyond = left.min(0).unsigned_abs() as usize;
        let Some((before, ring)) = ring.split_at_mut_checked(beyond * depth) else { return };
        let first_column = left.max(0);
        let steps = steps.get(first_column as usize..).unwrap_or_default();
        let (nearest, step) = if is_mirrored { (last_column - first_column, -1) } else { (first_column, 1) };
        let nearest = nearest + i32::from(min_disparity);
        // Small processors search a single vector of eight disparities, and know by this how many samples there are.
        match ring.as_chunks_mut::<8>() {
            (columns, []) if depth == 8 => {
                let mut first = nearest;
                for (samples, &steps) in columns.iter_mut().zip(steps) {
                    blend_from(line, first, prior.offset(steps), samples);
                    first += step;
                }
            }
            _ => {
                let mut first = nearest;
                for (samples, &steps) in ring.chunks_exact_mut(depth.max(1)).zip(steps) {
                    blend_from(line, first, prior.offset(steps), samples);
                    first += step;
                }
            }
        }
        if let Some(first) = ring.get(..depth) {
            before.chunks_exact_mut(depth.max(1)).for_each(|samples| copy(first, samples));
        }
        if let Some((inside, after)) = ring.split_at_mut_checked(steps.len() * depth)
            && let Some(last) = inside.rchunks_exact(depth.max(1)).next()
        {
            after.chunks_exact_mut(depth.max(1)).for_each(|samples| copy(last, samples));
        }
    }

    /// [`warp`](WarpedRows::warp) anywhere in the image plane.
    fn warp_spread(&mut self, v: i32, steps: &[i16]) {
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
            let sample = |k: i32| line(row + k * step_down).get((column + k * step).min(last_column).max(0) as usize);
            blend(samples, (0..).map_while(sample), rest);
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

/// Fills samples with those between neighbours of a line from column `nearest` on, moved by an offset.
#[inline(always)]
fn blend_from(line: &[u8], nearest: i32, (offset, rest): (i16, u8), samples: &mut [u8]) {
    let first = nearest + i32::from(offset);
    match line.get(first as usize..(first as usize).wrapping_add(samples.len() + 1)) {
        Some(from) => blend_contiguous(samples, from, rest),
        None => blend_beyond(line, first, rest, samples),
    }
}

/// [`blend_from`] where the line ends: its first and its last sample repeat.
#[inline(never)]
fn blend_beyond(line: &[u8], first: i32, rest: u8, samples: &mut [u8]) {
    let last = line.len() as i32 - 1;
    if first >= last {
        samples.fill(line.last().copied().unwrap_or_default());
    } else if first + samples.len() as i32 <= 0 {
        samples.fill(line.first().copied().unwrap_or_default());
    } else {
        blend(samples, (0..).map_while(|k| line.get((first + k).min(last).max(0) as usize)), rest);
    }
}

/// [`blend`], of contiguous samples: eight at a time.
#[inline(always)]
fn blend_contiguous(samples: &mut [u8], mut from: &[u8], rest: u8) {
    let (eights, others) = samples.as_chunks_mut::<8>();
    for eight in eights {
        let (Some(nine), Some(next)) = (from.first_chunk(), from.get(8..)) else { return };
        blend_eight(eight, nine, rest);
        from = next;
    }
    blend(others, from.iter(), rest);
}

/// [`blend`], of eight samples: two in each word.
#[inline(always)]
fn blend_eight(samples: &mut [u8; 8], from: &[u8; 9], rest: u8) {
    const LOW: u32 = 0x00ff_00ff;
    // So many that a sample is the upper byte of its sum.
    const STEPS: u32 = 1 << 8;
    let far_weight = u32::from(rest) * (STEPS / Disparity::STEPS as u32);
    let near_weight = STEPS - far_weight;
    let sum = |near: u32, far: u32| near * near_weight + far * far_weight + 0x0080_0080;
    let (near, far) = (from.as_chunks::<4>().0, from.split_at(1).1.as_chunks::<4>().0);
    for ((four, near), far) in samples.as_chunks_mut::<4>().0.iter_mut().zip(near).zip(far) {
        let (near, far) = (u32::from_le_bytes(*near), u32::from_le_bytes(*far));
        let (even, odd) = (sum(near & LOW, far & LOW), sum(near >> 8 & LOW, far >> 8 & LOW));
        *four = ((even >> 8 & LOW) + (odd & !LOW)).to_le_bytes();
    }
}

/// Copies as many samples as there are.
fn copy(from: &[u8], to: &mut [u8]) {
    to.iter_mut().zip(from).for_each(|(to, &from)| *to = from);
}
