//! A line of the disparities around which is searched.

use core::ops::Range;

use crate::{Disparity, Search, View, params::Prior};

/// A line of a prior: the disparity of each pixel from an earlier match, if it has one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PriorLine<'a> {
    pub prior: Prior,
    pub pixels: &'a [Option<Disparity>],
}

impl PriorLine<'_> {
    /// The prior of column `u`.
    #[inline(always)]
    fn at(&self, u: usize) -> Option<Disparity> {
        self.pixels.get(u).copied().flatten().filter(|&d| self.prior.contains(d))
    }

    /// The disparities at which both samples of the match of pixel `(u, v)` of this line lie inside a frame of `size`, as
    /// indices into the `count` disparities from `least` on. A pixel without a prior has none.
    #[inline(always)]
    pub fn available(&self, view: View, pixel: (usize, usize), size: (usize, usize), least: i16, count: usize) -> Range<u16> {
        let Some(d) = self.at(pixel.0) else { return 0..0 };
        let (offset, _) = self.prior.offset(d.to_bits());
        let samples = view.available(pixel, size, least.wrapping_add(offset), count + 1);
        samples.start..samples.end.saturating_sub(1).max(samples.start)
    }

    /// The disparity of column `u`, where `search` found this one around the prior. The prior remains if none was found,
    /// or if costs still fall at the end of the search.
    #[inline(always)]
    pub fn refined(&self, u: usize, search: &Search, found: Option<Disparity>) -> Option<Disparity> {
        let prior = self.at(u)?;
        let ends = [search.min_disparity(), search.max_disparity()];
        match found {
            Some(found) if !ends.map(Disparity::whole).contains(&Some(found)) => self.prior.moved(prior, found),
            _ => Some(prior),
        }
    }
}
