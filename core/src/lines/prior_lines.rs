//! The lines of the prior under the lower half of a block.

use crate::{Disparity, MatchError, ScanlineSource, params::Prior, prior_line::PriorLine};

/// A ring buffer of the disparities around which is searched.
#[derive(Debug)]
pub(crate) struct PriorLines<'m> {
    prior: Prior,
    /// From the line that is computed to the lowest under its blocks.
    lines: &'m mut [Option<Disparity>],
    /// The offsets of the line that was read last, one for each pixel.
    offsets: &'m mut [i16],
    /// The next line to be read.
    next: usize,
}

impl<'m> PriorLines<'m> {
    /// No lines yet; the first to be read is `next`. `lines` has room for whole lines of as many pixels as `offsets` has.
    pub fn new(prior: Prior, lines: &'m mut [Option<Disparity>], offsets: &'m mut [i16], next: usize) -> PriorLines<'m> {
        PriorLines { prior, lines, offsets, next }
    }

    /// Reads the lines up to `v`.
    pub fn read_ahead<S: ScanlineSource>(&mut self, source: &mut S, v: usize) -> Result<(), MatchError<S::Error>> {
        while self.next <= v {
            let line = place(self.next, self.lines.len(), self.offsets.len());
            let Some(line) = self.lines.get_mut(line) else { return Ok(()) };
            source.read_prior(self.next, line).map_err(MatchError::Source)?;
            let mut last = self.prior.nearest_to_zero();
            for (offset, pixel) in self.offsets.iter_mut().zip(line) {
                last = pixel.and_then(|d| self.prior.offset(d)).unwrap_or(last);
                *offset = last;
            }
            self.next += 1;
        }
        Ok(())
    }

    /// The offsets of the line that was read last.
    pub fn offsets(&self) -> &[i16] {
        self.offsets
    }

    /// Line `v`.
    pub fn line(&self, v: usize) -> PriorLine<'_> {
        let line = place(v, self.lines.len(), self.offsets.len());
        PriorLine { prior: self.prior, pixels: self.lines.get(line).unwrap_or_default() }
    }
}

/// Where line `v` of `width` pixels is in a ring of `pixels`.
fn place(v: usize, pixels: usize, width: usize) -> core::ops::Range<usize> {
    let lines = pixels.checked_div(width).unwrap_or_default();
    let start = v.checked_rem(lines).unwrap_or_default() * width;
    start..start + width
}
