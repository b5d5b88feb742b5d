//! Extended lines of a frame, in any order, and their census transform.

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
    held: [u16; MOST_LINES],
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
        LineRing { samples, held: [u16::MAX; MOST_LINES], spacing, width, height }
    }

    /// Makes sure that the ring holds the lines which line `v` needs. `read` computes the `width` samples of a line.
    #[inline(always)]
    pub fn prepare(&mut self, v: usize, mut read: impl FnMut(usize, &mut [S])) {
        let reach = RADIUS[0] * self.spacing;
        for dy in (0..=2 * RADIUS[1]).map(|line| line as isize - RADIUS[1] as isize) {
            let row = self.row(v, dy);
            let (place, start) = self.place(row);
            let Some(held) = self.held.get_mut(place).filter(|held| usize::from(**held) != row) else { continue };
            *held = row as u16;
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
        descriptors.fill(0);
        let mut planes = descriptors.chunks_exact_mut(self.width.max(1));
        let mut plane: &mut [u8] = &mut [];
        for (bit, [one, other]) in pairs.enumerate() {
            if bit % 8 == 0 {
                plane = planes.next().unwrap_or_default();
            }
            for ((byte, one), other) in plane.iter_mut().zip(self.shifted(v, one)).zip(self.shifted(v, other)) {
                *byte |= u8::from(one < other) << (bit % 8);
            }
        }
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
