//! The fusion rules in lanes.

use super::vector::{Block, Lane};
use crate::Fusion;

/// How the costs of the views are fused in lanes.
///
/// This states [`Fusion::fuse`] for vectors. Costs are on a scale that keeps them small where all views are
/// available: a factor common to all candidates of a pixel changes neither which one is least nor where the
/// parabola through its neighbours has its vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The least cost.
    Min,
    /// The sum of all costs.
    Sum,
    /// Six times the mean of the least three or two costs, of three or four views.
    Heuristic,
}

impl Rule {
    /// The rule for one to four views.
    pub const fn new(fusion: Fusion, views: usize) -> Rule {
        match (fusion, views) {
            (Fusion::Min, _) | (_, ..=1) => Rule::Min,
            (Fusion::Mean, _) | (Fusion::Heuristic, 2) => Rule::Sum,
            (Fusion::Heuristic, _) => Rule::Heuristic,
        }
    }

    /// Whether masks can hide views where they are not available, by the cost [`Lane::MAX`], if `incomplete`
    /// of `views` views are not available at all disparities.
    ///
    /// A sum has no such cost. The heuristic rule ignores it, unless it is left with a single view.
    pub const fn masks(self, views: usize, incomplete: usize) -> bool {
        match self {
            Rule::Min => true,
            Rule::Sum => false,
            Rule::Heuristic => views >= incomplete + 2,
        }
    }

    /// The factor from the cost of one view to the costs fused in lanes, of `views` views: of all of them by
    /// [`fuse`](Rule::fuse), of those available otherwise. The heuristic rule has the same for both.
    pub(crate) const fn scale(self, views: usize, is_complete: bool) -> u32 {
        match (self, views) {
            (Rule::Min, _) => 1,
            (Rule::Heuristic, _) => 6,
            (Rule::Sum, 2) => 2,
            (Rule::Sum, _) if is_complete => views as u32,
            (Rule::Sum, _) => 12,
        }
    }

    /// Fuses the costs of views that are all available.
    #[inline(always)]
    pub(crate) fn fuse<L: Lane, B: Block<L>, const V: usize>(self, costs: [B; V]) -> B {
        match (self, &costs[..]) {
            (Rule::Sum, &[a, b]) => a.add(b),
            (Rule::Sum, &[a, b, c]) => a.add(b).add(c),
            (Rule::Sum, &[a, b, c, d]) => a.add(b).add(c).add(d),
            (Rule::Heuristic, &[a, b, c]) => {
                let (low, high) = (a.min(b), a.max(b));
                heuristic(low.min(c), low.max(c).min(high), high.max(c))
            }
            (Rule::Heuristic, &[a, b, c, d]) => {
                let ((a, b), (c, d)) = ((a.min(b), a.max(b)), (c.min(d), c.max(d)));
                // The second and the third lie between the greater minimum and the lesser maximum.
                let (x, y) = (a.max(c), b.min(d));
                heuristic(a.min(c), x.min(y), x.max(y))
            }
            _ => {
                let mut least = costs[0];
                for &cost in costs.iter().skip(1) {
                    least = least.min(cost);
                }
                least
            }
        }
    }

    /// Fuses the costs of the `available` views, a bit for each, on one scale whatever their number. An
    /// unavailable view has the cost [`Rule::neutral`]. `maximum` is [`Lane::MAX`] in every lane: the cost if
    /// no view is available.
    #[inline(always)]
    pub(super) fn fuse_available<L: Lane, B: Block<L>, const V: usize>(self, available: u8, costs: [B; V], maximum: B) -> B {
        match (self, available.count_ones()) {
            (_, 0) => maximum,
            (Rule::Min, _) => Rule::Min.fuse(costs),
            (Rule::Heuristic, 1) => six_times(Rule::Min.fuse(costs)),
            (Rule::Heuristic, _) => Rule::Heuristic.fuse(costs),
            (Rule::Sum, count) => {
                let sum = Rule::Sum.fuse(costs);
                match (V, count) {
                    (2, 2) => sum,
                    (2, _) => sum.add(sum),
                    (_, 4) => sum.add(sum).add(sum),
                    (_, 3) => sum.add(sum).add(sum.add(sum)),
                    (_, 2) => six_times(sum),
                    (_, _) => six_times(sum.add(sum)),
                }
            }
        }
    }

    /// The cost of an unavailable view that leaves the fused cost of the others as it is.
    #[inline(always)]
    pub(super) fn neutral<L: Lane>(self) -> L {
        if self == Rule::Sum { L::default() } else { L::MAX }
    }
}

/// Six times the mean of `c1 <= c2 <= c3`, or of the first two if `c3 > 3 c2`.
///
/// Saturation in 16 bits changes nothing but the result: where `3 c2` saturates, no `c3` is greater either
/// way. Nor does a third cost of [`Lane::MAX`] that stands for an unavailable view: where it is not greater
/// than `3 c2`, the cost of the first two has saturated too.
#[inline(always)]
fn heuristic<L, B: Block<L>>(c1: B, c2: B, c3: B) -> B {
    let two = c1.add(c2);
    let three = two.add(c3);
    c3.if_greater(c2.add(c2).add(c2), two.add(two).add(two), three.add(three))
}

#[inline(always)]
fn six_times<L, B: Block<L>>(cost: B) -> B {
    let twice = cost.add(cost);
    twice.add(twice).add(twice)
}
