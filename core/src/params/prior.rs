//! The prior: the disparities of an earlier match, for a search at a longer baseline.

use core::ops::Range;

use crate::{Disparity, SearchSpace, View};

/// Disparities that are known from an earlier match of the same centre at a shorter baseline, and around which views
/// several baselines away are searched: see [`BlockMatchingParams::around`](crate::BlockMatchingParams::around).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Prior {
    /// The number of baselines of the earlier match in one of the search.
    pub(super) multiple: u8,
    pub(super) min_disparity: i16,
    pub(super) max_disparity: i16,
}

impl Prior {
    /// The number of baselines of the prior in one of the search around it: 1 to 16.
    pub const fn multiple(&self) -> u8 {
        self.multiple
    }

    /// The smallest disparity that the prior may have, in its pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.min_disparity
    }

    /// The largest disparity that the prior may have, in its pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.max_disparity
    }

    /// True if the prior may have the disparity `d`.
    #[inline(always)]
    pub(crate) const fn contains(&self, d: Disparity) -> bool {
        let (bits, steps) = (d.to_bits() as i32, Disparity::STEPS);
        self.min_disparity as i32 * steps <= bits && bits <= self.max_disparity as i32 * steps
    }

    /// The steps of the disparity nearest to 0 that the prior may have.
    #[inline(always)]
    pub(crate) const fn nearest_to_zero(&self) -> i16 {
        let nearest = match self.min_disparity > 0 {
            true => self.min_disparity,
            false if self.max_disparity < 0 => self.max_disparity,
            false => 0,
        };
        nearest.wrapping_mul(Disparity::STEPS as i16)
    }

    /// The disparity in pixels of the search at a prior of `bits` steps: whole pixels, and the steps that remain.
    #[inline(always)]
    pub(crate) const fn offset(&self, bits: i16) -> (i16, u8) {
        let steps = self.multiple as i32 * bits as i32;
        (steps.div_euclid(Disparity::STEPS) as i16, steps.rem_euclid(Disparity::STEPS) as u8)
    }

    /// The prior `d`, moved by what a search `found` around it, in pixels of the search. That is rounded to the nearest
    /// step of the prior, halves away from zero.
    #[inline(always)]
    pub(crate) fn moved(&self, d: Disparity, found: Disparity) -> Option<Disparity> {
        let (bits, multiple) = (i32::from(found.to_bits()), i32::from(self.multiple));
        let half = if bits < 0 { -(multiple / 2) } else { multiple / 2 };
        Disparity::from_bits((i32::from(d.to_bits()) + (bits + half).checked_div(multiple)?) as i16)
    }
}

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
    pub fn refine(&self, columns: Range<usize>, search: &SearchSpace, found: &mut [Option<Disparity>]) {
        let steps = Disparity::STEPS;
        let (least, most) = (i32::from(search.min_disparity()) * steps, i32::from(search.max_disparity()) * steps);
        for (pixel, &prior) in found.iter_mut().zip(self.pixels.get(columns).unwrap_or_default()) {
            // A disparity that was found lies between the ends of the search, or at one of them.
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
