//! Masks that hide block sums where a view is not available.

use core::{ops::Range, slice};

use super::{blocks::Blocks, rule::Rule, vector::Lane};
use crate::{availability::Availability, prior_line::PriorLine};

/// Masks for the block sums of a pixel: [`Lane::MAX`] where a view is not available, and in lanes past the
/// last disparity; zero elsewhere.
///
/// They follow the pixel lane by lane: at a border, few of them change from one pixel to the next.
#[derive(Debug)]
pub(crate) struct Masks<'a, L: Lane, I: Blocks<L>, const V: usize> {
    /// All [`Lane::MAX`] at first.
    pub vectors: &'a mut [[I::Costs; V]],
    pub availability: &'a mut Availability,
    /// Around which the line is searched.
    pub prior: Option<PriorLine<'a>>,
    /// True if there are lanes past the last disparity.
    pub padded: bool,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Masks<'_, L, I, V> {
    /// Goes to pixel `(u, v)`.
    pub fn enter_line(&mut self, u: usize, v: usize) {
        self.availability.enter_line(u, v, self.prior, |k, index, available| set::<L, I, V>(self.vectors, k, index, available));
    }

    /// Goes to the pixel at `u`, to the right in the same line, and returns whether anything may have
    /// changed.
    #[inline(always)]
    pub fn enter(&mut self, u: usize) -> bool {
        self.availability.enter::<V>(u, self.prior, |k, index, available| set::<L, I, V>(self.vectors, k, index, available))
    }

    /// The views that are not available at all disparities in all of these columns of the line, as bits.
    #[inline(always)]
    pub fn incomplete_in(&self, columns: Range<usize>) -> u8 {
        self.availability.incomplete_in(columns, self.prior)
    }

    /// The views whose masks are not zero, as bits, or `None` if masks cannot hide views from `rule` here. If
    /// no view has to be hidden there are none: lanes past the last disparity are then left to the caller.
    #[inline(always)]
    pub fn masked(&self, rule: Rule) -> Option<u8> {
        let incomplete = self.availability.incomplete();
        let masked = if incomplete != 0 && self.padded { u8::MAX } else { incomplete };
        Self::can_hide(rule, incomplete).then_some(masked)
    }

    /// True if masks can hide `incomplete` views, a bit for each, from `rule`.
    #[inline(always)]
    pub fn can_hide(rule: Rule, incomplete: u8) -> bool {
        let hides_from_sum = const { I::MASKS_SUM && V <= 4 } && rule == Rule::Sum;
        incomplete == 0 || hides_from_sum || rule.masks(V, incomplete.count_ones() as usize)
    }
}

/// Sets the mask of the `k`-th view at a disparity.
#[inline(always)]
fn set<L: Lane, I: Blocks<L>, const V: usize>(vectors: &mut [[I::Costs; V]], k: usize, index: usize, available: bool) {
    let vector = vectors.get_mut(index / I::LANES).and_then(|views| views.get_mut(k));
    let lanes = vector.and_then(|vector| bytemuck::try_cast_slice_mut::<_, L>(slice::from_mut(vector)).ok());
    if let Some(lane) = lanes.and_then(|lanes| lanes.get_mut(I::lane(index % I::LANES))) {
        *lane = if available { L::default() } else { L::MAX };
    }
}
