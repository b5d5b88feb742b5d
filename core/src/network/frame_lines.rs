//! Lines of frames that lie whole in memory: extended, blurred, and their descriptors by candidate.

use core::array;

use crate::{View, semi_global::set_descriptors};

/// The window of all census transforms: 4 pixels to each side, 3 up and down.
const RADIUS: [usize; 2] = [4, 3];
/// The most lines in a ring: those under a window of three times the size.
const MOST_LINES: usize = 6 * RADIUS[1] + 1;

/// The two pixels that a bit compares, each by its offset `[dx, dy]`. It is set if the first is darker.
pub(super) type Pair = [[isize; 2]; 2];

/// The lines of a frame that the descriptors of a line need, extended to both sides by replication.
///
/// From a line to the next above or below, a single line is new.
#[derive(Debug)]
pub(super) struct LineRing<'m, S> {
    samples: &'m mut [S],
    /// The line of the frame that each line of the ring holds, or `u16::MAX`.
    stored_rows: [u16; MOST_LINES],
    /// From a pixel of the window to the next, 1 or 3.
    spacing: usize,
    width: usize,
    height: usize,
}

impl<'m, S: Copy + PartialOrd> LineRing<'m, S> {
    /// The samples of a ring for frames of `width` columns.
    pub const fn samples(spacing: usize, width: usize) -> usize {
        (2 * RADIUS[1] * spacing + 1) * (width + 2 * RADIUS[0] * spacing)
    }

    /// No lines yet. There are as many samples as [`samples`](LineRing::samples), with any content.
    pub fn new(spacing: usize, [width, height]: [usize; 2], samples: &'m mut [S]) -> LineRing<'m, S> {
        LineRing { samples, stored_rows: [u16::MAX; MOST_LINES], spacing, width, height }
    }

    /// Makes sure that the ring holds the lines which line `v` needs. `read` computes the `width` samples of a line.
    #[inline(always)]
    pub fn prepare(&mut self, v: usize, mut read: impl FnMut(usize, &mut [S])) {
        let reach = RADIUS[0] * self.spacing;
        for dy in (0..=2 * RADIUS[1]).map(|line| line as isize - RADIUS[1] as isize) {
            let row = self.row(v, dy);
            let (place, start) = self.place(row);
            let Some(stored_row) = self.stored_rows.get_mut(place).filter(|stored_row| usize::from(**stored_row) != row) else {
                continue;
            };
            *stored_row = row as u16;
            let Some(line) = self.samples.get_mut(start..start + self.width + 2 * reach) else { continue };
            let Some((before, line)) = line.split_at_mut_checked(reach) else { continue };
            let Some((line, after)) = line.split_at_mut_checked(self.width) else { continue };
            read(row, line);
            if let (Some(&first), Some(&last)) = (line.first(), line.last()) {
                before.fill(first);
                after.fill(last);
            }
        }
    }

    /// Computes the descriptors of line `v`, which the ring is [prepared](LineRing::prepare) for: one plane of bytes after the
    /// other.
    #[inline(always)]
    pub fn transform(&self, v: usize, pairs: impl Iterator<Item = Pair>, descriptors: &mut [u8]) {
        set_descriptors(descriptors, self.width, pairs.map(|pair| pair.map(|offset| self.shifted(v, offset))));
    }

    /// The samples at an offset from each pixel of line `v`, in pixels of the window.
    #[inline(always)]
    fn shifted(&self, v: usize, [dx, dy]: [isize; 2]) -> &[S] {
        let (_, start) = self.place(self.row(v, dy));
        let start = start + (self.spacing * RADIUS[0]).wrapping_add_signed(self.spacing as isize * dx);
        self.samples.get(start..start + self.width).unwrap_or_default()
    }

    /// The line `dy` pixels of the window below line `v`, or the nearest in the frame.
    fn row(&self, v: usize, dy: isize) -> usize {
        v.saturating_add_signed(self.spacing as isize * dy).min(self.height.saturating_sub(1))
    }

    /// The line of the ring for a line of the frame, and its start.
    fn place(&self, row: usize) -> (usize, usize) {
        let place = row % (2 * RADIUS[1] * self.spacing + 1);
        (place, place * (self.width + 2 * RADIUS[0] * self.spacing))
    }
}

/// A Gaussian with a standard deviation of 1.5 pixels, in 256ths: the weights of a pixel and of those 1 to 4 pixels to
/// either side.
const WEIGHTS: [u16; 5] = [68, 55, 28, 9, 2];
const _: () = assert!(WEIGHTS[0] + 2 * (WEIGHTS[1] + WEIGHTS[2] + WEIGHTS[3] + WEIGHTS[4]) == 256);

/// The reach of the Gaussian in pixels.
const REACH: usize = WEIGHTS.len() - 1;

/// The column sums that [`blur`] needs for a frame of `width` columns.
pub(super) const fn column_sums(width: usize) -> usize {
    width + 2 * REACH
}

/// Computes line `v` of the blurred frame, in 256ths of a grey level, rounded half up. `line` has a sample for each column, and
/// there are as many sums as [`column_sums`]. The frame is replicated beyond its borders.
// Along columns first, since a single line is blurred at a time. Sums are not rounded, so the order changes nothing.
#[inline(always)]
pub(super) fn blur(frame: &[u8], v: usize, sums: &mut [u16], blurred: &mut [u16]) {
    let width = blurred.len();
    let line = |v: usize| frame.get(v * width..(v + 1) * width);
    let Some((before, rest)) = sums.split_at_mut_checked(REACH) else { return };
    let Some((middle, after)) = rest.split_at_mut_checked(width) else { return };
    let last = frame.len().checked_div(width).unwrap_or_default().saturating_sub(1);
    // Sums are at most 256 times a sample, so that they fit 16 bits.
    for (sum, &sample) in middle.iter_mut().zip(line(v).unwrap_or_default()) {
        *sum = WEIGHTS[0] * u16::from(sample);
    }
    for (k, weight) in WEIGHTS.into_iter().enumerate().skip(1) {
        let (Some(above), Some(below)) = (line(v.saturating_sub(k)), line((v + k).min(last))) else { return };
        for ((sum, &above), &below) in middle.iter_mut().zip(above).zip(below) {
            *sum = sum.wrapping_add(weight * (u16::from(above) + u16::from(below)));
        }
    }
    let (Some(&first), Some(&end)) = (middle.first(), middle.last()) else { return };
    before.fill(first);
    after.fill(end);
    for (sample, sums) in blurred.iter_mut().zip(sums.windows(2 * REACH + 1)) {
        let &[a, b, c, d, e, f, g, h, i] = sums else { return };
        let [center, one, two, three, four] = WEIGHTS.map(u32::from);
        let pair = |one: u16, other: u16| u32::from(one) + u32::from(other);
        let total = center * u32::from(e) + one * pair(d, f) + two * pair(c, g) + three * pair(b, h) + four * pair(a, i);
        *sample = ((total + 128) >> 8) as u16;
    }
}

/// Bytes of a descriptor.
pub(super) const BYTES: usize = 4;

/// The descriptors of a line of a horizontal view: a plane for each of their bytes.
///
/// In a view `n` baselines away, the matches of a pixel at successive disparities lie `n` columns apart. So a plane consists of
/// `n` phases, one after the other: each has the columns with the same remainder. Lines are mirrored if matches move to the left.
#[derive(Debug)]
pub(super) struct CandidatePlanes<'m> {
    planes: &'m mut [u8],
    /// True if matches move to the left with the disparity.
    mirrored: bool,
    /// Baselines between the view and the centre.
    baselines: usize,
    /// Bytes of a phase.
    phase: usize,
    min_disparity: i16,
    width: usize,
}

impl<'m> CandidatePlanes<'m> {
    /// The bytes of the planes, with `depth` candidates for each pixel.
    pub const fn bytes(view: View, width: usize, depth: usize) -> usize {
        let baselines = view.right().unsigned_abs() as usize;
        BYTES * baselines * phase_bytes(baselines, width, depth)
    }

    /// No descriptors yet. The planes have as many bytes as [`bytes`](CandidatePlanes::bytes), with any content.
    pub fn new(view: View, width: usize, depth: usize, min_disparity: i16, planes: &'m mut [u8]) -> CandidatePlanes<'m> {
        let baselines = view.right().unsigned_abs().into();
        let phase = phase_bytes(baselines, width, depth);
        CandidatePlanes { planes, mirrored: view.right() > 0, baselines, phase, min_disparity, width }
    }

    /// Takes the descriptors of a line, one plane of bytes after the other.
    pub fn put(&mut self, descriptors: &[u8]) {
        // The first pixel of a phase that some candidate has, and where it is stored.
        let (skipped, first) = (self.min_disparity.max(0) as usize, (-self.min_disparity).max(0) as usize);
        let planes = self.planes.chunks_exact_mut((self.baselines * self.phase).max(1));
        for (plane, line) in planes.zip(descriptors.chunks_exact(self.width.max(1))) {
            for (remainder, phase) in plane.chunks_exact_mut(self.phase.max(1)).enumerate() {
                let outside = remainder + self.baselines * skipped;
                let stored = phase.get_mut(first..).unwrap_or_default().iter_mut();
                let step = self.baselines.max(1);
                if self.mirrored {
                    let line = line.get(..self.width.saturating_sub(outside)).unwrap_or_default();
                    stored.zip(line.iter().rev().step_by(step)).for_each(|(to, &byte)| *to = byte);
                } else {
                    let line = line.get(outside..).unwrap_or_default();
                    stored.zip(line.iter().step_by(step)).for_each(|(to, &byte)| *to = byte);
                }
            }
        }
    }

    /// The planes of the `depth` candidates of the pixel in column `u`, from the smallest disparity on. Those outside the frame
    /// have any content.
    #[inline(always)]
    pub fn candidates(&self, u: usize, depth: usize) -> [&[u8]; BYTES] {
        let u = if self.mirrored { self.width.saturating_sub(1 + u) } else { u };
        let (place, remainder) = match self.baselines {
            1 => (u, 0),
            baselines => (u.checked_div(baselines).unwrap_or_default(), u.checked_rem(baselines).unwrap_or_default()),
        };
        let start = remainder * self.phase + place;
        let plane = self.baselines * self.phase;
        array::from_fn(|byte| self.planes.get(byte * plane + start..).and_then(|rest| rest.get(..depth)).unwrap_or_default())
    }
}

/// The bytes of a phase: the candidates of its first pixel, and one more for each other pixel.
const fn phase_bytes(baselines: usize, width: usize, depth: usize) -> usize {
    match width.checked_add(baselines) {
        // Of the widest phase.
        Some(end) if baselines > 0 => (end - 1) / baselines + depth - 1,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the smallest sizes as well. A point of 32 has a total of exactly a half at the corners of the Gaussian.
    #[test]
    fn lines_have_the_blurred_samples_of_the_definition() {
        let noise: [u8; 120] = core::array::from_fn(|i| (i * i * 89 + i * 31 + i / 5) as u8);
        let point: [u8; 120] = core::array::from_fn(|i| if i == 5 * 12 + 6 { 32 } else { 0 });
        for (frame, width, height) in
            [(&noise, 1, 1), (&noise, 1, 7), (&noise, 3, 2), (&noise, 12, 10), (&noise, 16, 1), (&point, 12, 10)]
        {
            let frame = &frame[..width * height];
            let sample = |u: i32, v: i32| {
                let [u, v] = [(u, width), (v, height)].map(|(at, side)| at.clamp(0, side as i32 - 1) as usize);
                u32::from(frame[v * width + u])
            };
            let weight = |k: i32| u32::from(WEIGHTS[k.unsigned_abs() as usize]);
            for v in 0..height {
                let (mut sums, mut blurred) = ([99; 24], [99; 16]);
                blur(frame, v, &mut sums[..column_sums(width)], &mut blurred[..width]);
                for (u, &blurred) in blurred.iter().enumerate().take(width) {
                    let at = |du, dv| weight(du) * weight(dv) * sample(u as i32 + du, v as i32 + dv);
                    let total: u32 = (-4..=4).flat_map(|dv| (-4..=4).map(move |du| at(du, dv))).sum();
                    assert_eq!(u32::from(blurred), (total + 128) / 256, "({u}, {v}) of {width}x{height}");
                }
            }
        }
    }
}
