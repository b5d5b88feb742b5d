//! The lines of the prior under the lower half of a block.

use crate::{Disparity, MatchError, ScanlineSource, params::Prior, prior_line::PriorLine};

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
