//! The descriptors of a view's line, so that those of a pixel's candidates are contiguous.

use core::array;

use crate::View;

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
