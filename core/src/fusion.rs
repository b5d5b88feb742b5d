//! The fusion of the matching costs of several views into one.

use crate::{Views, infallible};

/// The rule that fuses the matching costs `c1 <= c2 <= ...` of the views in which a candidate is available.
///
/// [`fuse`](Fusion::fuse) defines the rules for single costs. The [`kernel`](crate::kernel) states the same
/// rules for vectors.
///
/// ```
/// use multiscopic_core::Fusion;
/// // Three views agree. The fourth does not see the point.
/// let costs = [30.0, 33.0, 36.0, 901.0_f32];
/// assert_eq!(Fusion::Min.fuse(costs), 30.0);
/// assert_eq!(Fusion::Mean.fuse(costs), 250.0);
/// assert_eq!(Fusion::Heuristic.fuse(costs), 33.0);
/// assert_eq!(Fusion::Half.fuse(costs), 31.5);
///
/// // Distances of the census, in bits: it pays to leave out the views that do not see the point.
/// assert_eq!(Fusion::Trimmed.fuse([3.0, 5.0, 15.0, 17.0_f32]), 4.0 + 2.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fusion {
    /// The least cost, `c1` (paper, eq. 8). Sharp at occlusions, since one view that sees the point is
    /// enough.
    Min,
    /// The mean of all costs (paper, eq. 7). Suppresses noise, but blurs where some views do not see the
    /// point.
    Mean,
    /// The paper's heuristic rule (eq. 9): the mean of the three least costs, or of the two least if
    /// `c3 > 3 c2`. With two views it is their mean, with one view that view's cost.
    Heuristic,
    /// The mean of the least half of the costs: of `n` costs the least `n / 2`, rounded up. A point that some views
    /// do not see is seen by those on the other side, so half of an array is enough and quiet.
    Half,
    /// The adaptive trimmed mean of Hamming distances, for the [census](crate::Census) alone: the mean of all, or of the
    /// least half, quarter and so on plus a charge for leaving the others out, whichever is least.
    ///
    /// The fused cost of the least distance is that distance, and that of the `2 k` least is their mean, or the cost of
    /// the `k` least plus 2 bits, if that is less: the views of the others do not see the point. A single view that sees it
    /// costs 3 bits. Beyond a view's frame there is no distance: if there are fewer than `2 k`, it is the cost of the `k` least
    /// plus 1 bit. The result is that of the `m` least, of which `m` is the greatest power of two that is at most the number of
    /// views. It is quiet where all views see the point, and sharp where they do not.
    ///
    /// Sums of absolute differences have no such unit, so parameters with them are [refused](crate::ParamsError::Trimmed).
    Trimmed,
}

impl Fusion {
    /// Every rule.
    pub const ALL: [Fusion; 5] = [Fusion::Min, Fusion::Mean, Fusion::Heuristic, Fusion::Half, Fusion::Trimmed];

    /// The rules for costs of any kind, which have no unit.
    pub const OF_ANY_COSTS: [Fusion; 4] = [Fusion::Min, Fusion::Mean, Fusion::Heuristic, Fusion::Half];

    /// The rule's name on command lines and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Fusion::Min => "min",
            Fusion::Mean => "mean",
            Fusion::Heuristic => "heuristic",
            Fusion::Half => "half",
            Fusion::Trimmed => "trimmed",
        }
    }

    /// The rule for a number of views: the paper's, which is the minimum for one or two and the heuristic rule for
    /// three or four, and [`Half`](Fusion::Half) for more.
    pub const fn default_for(views: usize) -> Fusion {
        match views {
            0..=2 => Fusion::Min,
            3 | 4 => Fusion::Heuristic,
            _ => Fusion::Half,
        }
    }

    /// The rule for the Hamming distances of a [census](crate::Census) in a number of views: [`Trimmed`](Fusion::Trimmed), which
    /// is the minimum of one.
    pub const fn default_for_census(views: usize) -> Fusion {
        if views > 1 { Fusion::Trimmed } else { Fusion::default_for(views) }
    }

    /// The factor from the cost of one view to this rule's integer scale for so many views, at most
    /// [`Views::MAX`].
    ///
    /// On that scale every mean is a whole number, so candidates seen in different numbers of views compare
    /// exactly: it is a multiple of every number of costs that are averaged.
    pub const fn scale(self, views: usize) -> u64 {
        match self {
            Fusion::Min => 1,
            Fusion::Mean if views <= 4 => 12,
            Fusion::Mean if views <= 8 => 840,
            Fusion::Mean => 5_354_228_880,
            Fusion::Heuristic => 6,
            Fusion::Half if views <= 4 => 2,
            Fusion::Half if views <= 8 => 12,
            Fusion::Half => 27_720,
            Fusion::Trimmed => 1 << most_doublings(views),
        }
    }

    /// Fuses the costs of all views, [`NONE`](MatchingCost::NONE) where a view is not available, in
    /// any order.
    ///
    /// The result is `NONE` if no view is available. Integers come out on this rule's [`scale`](Fusion::scale); each must be at
    /// most 21 x 21 x 255, the largest block sum, so that no sum leaves 32 bits for [`Views::MAX_MATCHED`] views, and 53 bits for
    /// [`Views::MAX`]. Floats stay on the scale of one view. For [`Fusion::Trimmed`], `V` is the number of views of the search.
    #[inline]
    pub fn fuse<C: MatchingCost, const V: usize>(self, costs: [C; V]) -> C {
        match self {
            Fusion::Min => least(costs),
            Fusion::Mean => mean(costs),
            Fusion::Heuristic => heuristic(costs),
            Fusion::Half => half(costs),
            Fusion::Trimmed => trimmed(costs),
        }
    }
}

/// The greatest fused cost on the greatest scale is less than that of a candidate that does not exist, and can be
/// refined.
const _: () = {
    let largest = 255 * 21 * 21;
    assert!(largest * Fusion::Mean.scale(Views::MAX_MATCHED) < u32::MAX as u64);
    assert!(largest * Fusion::Mean.scale(Views::MAX) < 1 << 53);
};

/// A matching cost of one candidate, as [`Fusion`] needs it.
///
/// `u32` and `u64` costs are fused exactly, on the rule's scale. `f32` costs are fused on the scale of one view.
pub trait MatchingCost: Copy + PartialOrd {
    /// The cost of a candidate that is not available. It compares above all others.
    const NONE: Self;
    /// A cost of zero.
    const ZERO: Self;

    /// True if the candidate is available.
    #[inline]
    fn exists(self) -> bool {
        self != Self::NONE
    }

    /// The sum of two costs that exist.
    fn plus(self, other: Self) -> Self;

    /// Three times a cost that exists.
    fn tripled(self) -> Self;

    /// A cost of some units, times `scale` if costs are integers.
    fn of_units(units: u32, scale: u64) -> Self;

    /// The mean of `count` costs with this sum, times `scale` if costs are integers. `count` divides `scale`.
    fn mean(self, count: u32, scale: u64) -> Self;
}

impl MatchingCost for u32 {
    const NONE: u32 = u32::MAX;
    const ZERO: u32 = 0;

    #[inline]
    fn plus(self, other: u32) -> u32 {
        self.wrapping_add(other)
    }

    #[inline]
    fn tripled(self) -> u32 {
        self.wrapping_mul(3)
    }

    #[inline]
    fn of_units(units: u32, scale: u64) -> u32 {
        units.wrapping_mul(scale as u32)
    }

    #[inline]
    fn mean(self, count: u32, scale: u64) -> u32 {
        self.wrapping_mul(scale as u32 / count.max(1))
    }
}

impl MatchingCost for u64 {
    const NONE: u64 = u64::MAX;
    const ZERO: u64 = 0;

    #[inline]
    fn plus(self, other: u64) -> u64 {
        self.wrapping_add(other)
    }

    #[inline]
    fn tripled(self) -> u64 {
        self.wrapping_mul(3)
    }

    #[inline]
    fn of_units(units: u32, scale: u64) -> u64 {
        u64::from(units).wrapping_mul(scale)
    }

    #[inline]
    fn mean(self, count: u32, scale: u64) -> u64 {
        self.wrapping_mul(scale / u64::from(count.max(1)))
    }
}

impl MatchingCost for f32 {
    const NONE: f32 = f32::INFINITY;
    const ZERO: f32 = 0.0;

    #[inline]
    fn plus(self, other: f32) -> f32 {
        self + other
    }

    #[inline]
    fn tripled(self) -> f32 {
        3.0 * self
    }

    #[inline]
    fn of_units(units: u32, _scale: u64) -> f32 {
        units as f32
    }

    #[inline]
    fn mean(self, count: u32, _scale: u64) -> f32 {
        self / count as f32
    }
}

/// Paper, eq. 8.
#[inline]
fn least<C: MatchingCost, const V: usize>(costs: [C; V]) -> C {
    costs.into_iter().fold(C::NONE, |least, cost| if cost < least { cost } else { least })
}

/// Paper, eq. 7. Adds in the order of the views.
#[inline]
fn mean<C: MatchingCost, const V: usize>(costs: [C; V]) -> C {
    let (mut sum, mut count) = (C::ZERO, 0);
    for cost in costs {
        if cost.exists() {
            sum = sum.plus(cost);
            count += 1;
        }
    }
    if count == 0 { C::NONE } else { sum.mean(count, Fusion::Mean.scale(V)) }
}

/// Paper, eq. 9.
#[inline]
fn heuristic<C: MatchingCost, const V: usize>(costs: [C; V]) -> C {
    let [c1, c2, c3] = least_of(costs, 3);
    let mean = |sum: C, count| sum.mean(count, Fusion::Heuristic.scale(V));
    if !c1.exists() {
        C::NONE
    } else if !c2.exists() {
        mean(c1, 1)
    } else if !c3.exists() || c3 > c2.tripled() {
        mean(c1.plus(c2), 2)
    } else {
        mean(c1.plus(c2).plus(c3), 3)
    }
}

/// The mean of the least half. Adds in ascending order.
#[inline]
fn half<C: MatchingCost, const V: usize>(costs: [C; V]) -> C {
    let available = costs.iter().filter(|cost| cost.exists()).count();
    let (mut sum, count) = (C::ZERO, infallible::div_ceil(available, 2));
    for &cost in least_of::<C, V, V>(costs, infallible::div_ceil(V, 2)).iter().take(count) {
        sum = sum.plus(cost);
    }
    if count == 0 { C::NONE } else { sum.mean(count as u32, Fusion::Half.scale(V)) }
}

/// The adaptive trimmed mean: see [`Fusion::Trimmed`]. Adds in ascending order.
#[inline]
fn trimmed<C: MatchingCost, const V: usize>(costs: [C; V]) -> C {
    let sorted = least_of::<C, V, V>(costs, V);
    let scale = Fusion::Trimmed.scale(V);
    let Some(&least) = sorted.first().filter(|cost| cost.exists()) else { return C::NONE };
    let (mut sum, mut fused) = (least, least.mean(1, scale));
    for doubling in 1..=most_doublings(V) {
        let count = 1 << doubling;
        if !sorted.get(count - 1).is_some_and(|cost| cost.exists()) {
            fused = fused.plus(C::of_units(BEYOND_FRAME, scale));
            continue;
        }
        for &cost in sorted.iter().take(count).skip(count / 2) {
            sum = sum.plus(cost);
        }
        let (mean, trimmed) = (sum.mean(count as u32, scale), fused.plus(C::of_units(hidden(doubling), scale)));
        fused = if mean < trimmed { mean } else { trimmed };
    }
    fused
}

/// The exponent of the greatest power of two that is at most the number of views.
pub(crate) const fn most_doublings(views: usize) -> u32 {
    match views.checked_ilog2() {
        Some(most) => most,
        None => 0,
    }
}

/// The bits for which [`Fusion::Trimmed`] leaves out half of `2^doubling` views.
pub(crate) const fn hidden(doubling: u32) -> u32 {
    if doubling == 1 { 3 } else { 2 }
}

/// The bits for which [`Fusion::Trimmed`] does without views whose frames end before the match.
pub(crate) const BEYOND_FRAME: u32 = 1;

/// The `count` least costs in ascending order, at most `N`, by insertion: the standard library's sort is large.
#[inline]
fn least_of<C: MatchingCost, const V: usize, const N: usize>(costs: [C; V], count: usize) -> [C; N] {
    let mut least = [C::NONE; N];
    for (n, mut cost) in costs.into_iter().enumerate() {
        for sorted in least.iter_mut().take(count.min(n + 1)) {
            // Without a branch, which could not be predicted.
            (*sorted, cost) = if cost < *sorted { (cost, *sorted) } else { (*sorted, cost) };
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_named_and_chosen_by_the_number_of_views() {
        assert_eq!(Fusion::ALL.map(Fusion::name), ["min", "mean", "heuristic", "half", "trimmed"]);
        let chosen = [0, 1, 2, 3, 4, 5, 8, 24].map(|views| Fusion::default_for(views).name());
        assert_eq!(chosen, ["min", "min", "min", "heuristic", "heuristic", "half", "half", "half"]);
        assert_eq!([0, 1, 2, 24].map(|views| Fusion::default_for_census(views).name()), ["min", "min", "trimmed", "trimmed"]);
    }

    /// The scale is the least number that every number of averaged costs divides, of up to four views, eight, or an
    /// array.
    #[test]
    fn scales_are_least_common_multiples() {
        fn multiple(of: u64, and: u64) -> u64 {
            (1..).map(|n| n * of).find(|multiple| multiple.is_multiple_of(and)).expect("their product")
        }
        for views in 1..=24 {
            let most = [4, 8, 24].into_iter().find(|&most| views <= most).expect("at most all");
            let expected = |averaged: fn(usize) -> usize| (1..=most).map(averaged).fold(1, |scale, n| multiple(scale, n as u64));
            assert_eq!(Fusion::Min.scale(views), expected(|_| 1));
            assert_eq!(Fusion::Mean.scale(views), expected(|n| n));
            assert_eq!(Fusion::Heuristic.scale(views), expected(|n| n.min(3)), "{views} views");
            assert_eq!(Fusion::Half.scale(views), expected(|n| n.div_ceil(2)));
            assert!(Fusion::Trimmed.scale(views) <= views as u64 && views < 2 * Fusion::Trimmed.scale(views) as usize);
        }
    }
}
