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
    /// The disparity around which column `u` is searched, in whole pixels of the search.
    #[inline(always)]
    pub fn offset(&self, u: usize) -> Option<i16> {
        self.prior.offset((*self.pixels.get(u)?)?)
    }

    /// The disparities at which the match of pixel `(u, v)` of this line lies inside a frame of `size`, as indices into
    /// the `count` disparities from `least` on. A pixel without a prior has none.
    #[inline(always)]
    pub fn available(&self, view: View, pixel: (usize, usize), size: (usize, usize), least: i16, count: usize) -> Range<u16> {
        match self.offset(pixel.0) {
            Some(offset) => view.available(pixel, size, least.wrapping_add(offset), count),
            None => 0..0,
        }
    }

    /// The disparity of column `u`, where `search` found this one around the prior's. It stays the prior's if none was
    /// found, or if costs still fall at the end of the search.
    #[inline(always)]
    pub fn refined(&self, u: usize, search: &Search, found: Option<Disparity>) -> Option<Disparity> {
        let prior = self.pixels.get(u).copied().flatten();
        let offset = self.prior.offset(prior?)?;
        let ends = [search.min_disparity(), search.max_disparity()];
        match found {
            Some(found) if !ends.map(Disparity::whole).contains(&Some(found)) => self.prior.disparity(offset, found),
            _ => prior,
        }
    }
}
