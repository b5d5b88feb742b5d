//! A line of the disparities around which is searched.

use core::ops::Range;

use crate::{Disparity, Search, View, params::Prior};

/// A line of a prior: the disparity of each pixel from an earlier match, if it has one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PriorLine<'a> {
    pub prior: Prior,
    /// Each has a disparity that the prior may have, or none.
    pub pixels: &'a [Option<Disparity>],
}

impl PriorLine<'_> {
    /// The prior of column `u`.
    #[inline(always)]
    fn at(&self, u: usize) -> Option<Disparity> {
        self.pixels.get(u).copied().flatten()
    }

    /// The smallest disparity at which column `u` is searched, in pixels of the search, where `least` is the smallest around
    /// the prior. A pixel without a prior is not searched.
    #[inline(always)]
    pub fn first(&self, u: usize, least: i16) -> Option<i16> {
        let (offset, _) = self.prior.offset(self.at(u)?.to_bits());
        Some(least.wrapping_add(offset))
    }

    /// The disparities at which both samples of the match of pixel `(u, v)` of this line lie inside a frame of `size`, as
    /// indices into the `count` disparities from `least` on. A pixel without a prior has none.
    #[inline(always)]
    pub fn available(&self, view: View, pixel: (usize, usize), size: (usize, usize), least: i16, count: usize) -> Range<u16> {
        self.first(pixel.0, least).map(|first| available_from(first, view, pixel, size, count)).unwrap_or_default()
    }

    /// Puts the disparities of `columns` in place of those that `search` found around the prior. The prior remains where none
    /// was found, or if costs still fall at the end of the search.
    #[inline(always)]
    pub fn refine(&self, columns: Range<usize>, search: &Search, found: &mut [Option<Disparity>]) {
        let steps = Disparity::STEPS;
        let (least, most) = (i32::from(search.min_disparity()) * steps, i32::from(search.max_disparity()) * steps);
        for (pixel, &prior) in found.iter_mut().zip(self.pixels.get(columns).unwrap_or_default()) {
            // What is found lies between the ends of the search, or at one of them.
            let inner = pixel.filter(|found| (least + 1..most).contains(&i32::from(found.to_bits())));
            *pixel = match (prior, inner) {
                (Some(prior), Some(inner)) => self.prior.moved(prior, inner),
                _ => prior,
            };
        }
    }
}

/// The disparities at which both samples of the match of a pixel lie inside a frame of `size`, as indices into the `count`
/// disparities from `first` on.
#[inline(always)]
pub(crate) fn available_from(first: i16, view: View, pixel: (usize, usize), size: (usize, usize), count: usize) -> Range<u16> {
    let samples = view.available(pixel, size, first, count + 1);
    samples.start..samples.end.saturating_sub(1).max(samples.start)
}
