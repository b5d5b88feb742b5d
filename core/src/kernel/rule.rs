//! The fusion rules in lanes.

use super::isa::{Block, Lane};
use crate::{Fusion, Views, infallible};

/// The rule that fuses the costs of the views in lanes.
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
    /// Six times the mean of the least three or two costs, of three views or more.
    Heuristic,
    /// The sum of the least half of the costs, of three views or more.
    Half,
}

impl Rule {
    /// True if [`fuse`](Rule::fuse) knows [`Rule::Half`] of three views or more.
    pub(crate) const HAS_HALF: bool = Views::MAX_MATCHED > 4;

    /// The rule for one to eight views.
    pub const fn new(fusion: Fusion, views: usize) -> Rule {
        match (fusion, views) {
            // Parameters of block sums refuse `Trimmed`.
            (Fusion::Min | Fusion::Trimmed, _) | (_, ..=1) | (Fusion::Half, 2) => Rule::Min,
            (Fusion::Mean, _) | (Fusion::Heuristic, 2) => Rule::Sum,
            (Fusion::Heuristic, _) => Rule::Heuristic,
            (Fusion::Half, _) => Rule::Half,
        }
    }

    /// True if masks can hide views where they are not available, by the cost [`Lane::MAX`], if `incomplete`
    /// of `views` views are not available at all disparities.
    ///
    /// A sum has no such cost; some instruction sets mask it nevertheless. The heuristic rule ignores the cost, unless it
    /// is left with a single view.
    pub const fn masks(self, views: usize, incomplete: usize) -> bool {
        match self {
            Rule::Min | Rule::Half => true,
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
            (Rule::Half, _) if is_complete => infallible::div_ceil(views, 2) as u32,
            (Rule::Half, _) => Fusion::Half.scale(views) as u32,
            (Rule::Sum, 2) => 2,
            (Rule::Sum, _) if is_complete => views as u32,
            (Rule::Sum, _) => Fusion::Mean.scale(views) as u32,
        }
    }

    /// Fuses the costs of views that are all available.
    // Here and below: inlined but in firmware that is built without optimisation, which must fit its flash too.
    #[cfg_attr(not(all(debug_assertions, target_os = "none")), inline(always))]
    pub(crate) fn fuse<L: Lane, B: Block<L>, const V: usize>(self, costs: [B; V]) -> B {
        match (self, &costs[..]) {
            (Rule::Sum, &[a, b]) => a.add(b),
            (Rule::Sum, &[a, b, c]) => a.add(b).add(c),
            (Rule::Sum, &[a, b, c, d]) => a.add(b).add(c).add(d),
            (Rule::Sum, &[a, ref rest @ ..]) => sum(a, rest),
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
            (Rule::Heuristic, &[a, b, c, ref rest @ ..]) => {
                let [mut c1, mut c2, mut c3] = sorted_three([a, b, c]);
                for &cost in rest {
                    let (second, third) = (cost.max(c1), cost.max(c1).max(c2));
                    (c1, c2, c3) = (c1.min(cost), c2.min(second), c3.min(third));
                }
                heuristic(c1, c2, c3)
            }
            (Rule::Half, _) if Rule::HAS_HALF && V > 2 => half_of_all(costs),
            _ => {
                let mut least = costs[0];
                for &cost in costs.iter().skip(1) {
                    least = least.min(cost);
                }
                least
            }
        }
    }

    /// Fuses costs of which some may be `maximum`, [`Lane::MAX`] in every lane, where a mask hides the view. Sums are on
    /// the scale of [`fuse_available`](Rule::fuse_available).
    #[cfg_attr(not(all(debug_assertions, target_os = "none")), inline(always))]
    pub(crate) fn fuse_masked<L: Lane, B: Block<L>, const V: usize>(self, costs: [B; V], maximum: B) -> B {
        match self {
            Rule::Half if Rule::HAS_HALF && V > 2 => half_of_available(costs, maximum),
            Rule::Sum if matches!(V, 2..=4) => sum_of_available(costs, maximum),
            _ => self.fuse(costs),
        }
    }

    /// Fuses the costs of the `available` views, a bit for each, on one scale whatever their number. An
    /// unavailable view has the cost [`Rule::neutral`]. `maximum` is [`Lane::MAX`] in every lane: the cost if
    /// no view is available, and for the sum of some of five views or more, whose scale is too large for lanes.
    #[cfg_attr(not(all(debug_assertions, target_os = "none")), inline(always))]
    pub(super) fn fuse_available<L: Lane, B: Block<L>, const V: usize>(self, available: u8, costs: [B; V], maximum: B) -> B {
        match (self, available.count_ones()) {
            (_, 0) => maximum,
            (Rule::Half, _) if Rule::HAS_HALF && V > 2 => half_of_available(costs, maximum),
            // Of two costs, the least half is the least.
            (Rule::Min | Rule::Half, _) => Rule::Min.fuse(costs),
            (Rule::Heuristic, 1) => six_times(Rule::Min.fuse(costs)),
            (Rule::Heuristic, _) => Rule::Heuristic.fuse(costs),
            (Rule::Sum, _) if V > 4 => maximum,
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

/// The sum of costs.
#[inline(always)]
fn sum<L, B: Block<L>>(first: B, rest: &[B]) -> B {
    let mut sum = first;
    for &cost in rest {
        sum = sum.add(cost);
    }
    sum
}

/// The sum of the available costs of two to four, times as much as there are fewer: `maximum`, [`Lane::MAX`], where a
/// view is not available, and if none is.
#[cfg_attr(not(all(debug_assertions, target_os = "none")), inline(always))]
fn sum_of_available<L, B: Block<L>, const V: usize>(mut costs: [B; V], maximum: B) -> B {
    // Those that are available first.
    for i in 0..V {
        for j in i + 1..V {
            (costs[i], costs[j]) = (costs[i].min(costs[j]), costs[i].max(costs[j]));
        }
    }
    let twice = |cost: B| cost.add(cost);
    let one = costs[0];
    let mut fused = if V == 2 { twice(one) } else { six_times(twice(one)) };
    let mut total = one;
    for (k, &cost) in costs.iter().enumerate().skip(1) {
        total = total.add(cost);
        let scaled = match (V, k) {
            (2, _) => total,
            (_, 1) => six_times(total),
            (_, 2) => twice(twice(total)),
            (_, _) => twice(total).add(total),
        };
        fused = maximum.if_greater(cost, scaled, fused);
    }
    maximum.if_greater(one, fused, maximum)
}

/// Three costs in ascending order.
#[inline(always)]
fn sorted_three<L, B: Block<L>>([a, b, c]: [B; 3]) -> [B; 3] {
    let (low, high) = (a.min(b), a.max(b));
    let middle = low.max(c);
    [low.min(c), middle.min(high), middle.max(high)]
}

/// Four costs in ascending order.
#[inline(always)]
fn sorted_four<L, B: Block<L>>([a, b, c, d]: [B; 4]) -> [B; 4] {
    let ((a, b), (c, d)) = ((a.min(b), a.max(b)), (c.min(d), c.max(d)));
    let (x, y) = (a.max(c), b.min(d));
    [a.min(c), x.min(y), x.max(y), b.max(d)]
}

/// Two times four ascending costs in ascending order: the odd-even merge of Batcher (1968).
#[inline(always)]
fn merged<L, B: Block<L>>([a, b, c, d]: [B; 4], [e, f, g, h]: [B; 4]) -> [B; 8] {
    let ((a, e), (b, f)) = ((a.min(e), a.max(e)), (b.min(f), b.max(f)));
    let ((c, g), (d, h)) = ((c.min(g), c.max(g)), (d.min(h), d.max(h)));
    let ((c, e), (d, f)) = ((c.min(e), c.max(e)), (d.min(f), d.max(f)));
    let ((b, c), (d, e), (f, g)) = ((b.min(c), b.max(c)), (d.min(e), d.max(e)), (f.min(g), f.max(g)));
    [a, b, c, d, e, f, g, h]
}

// Of two ascending sequences of n costs, the n least of all are the lesser of each cost in one and its counterpart
// in the other, counted from the end.

/// The sum of the least two of three or four costs.
#[inline(always)]
fn least_two<L, B: Block<L>>([a, b]: [B; 2], c: B, d: Option<B>) -> B {
    let (a, b) = (a.min(b), a.max(b));
    match d {
        Some(d) => a.min(c.max(d)).add(b.min(c.min(d))),
        None => a.add(b.min(c)),
    }
}

/// The sum of the least four of two times four costs.
#[inline(always)]
fn least_four<L, B: Block<L>>(first: [B; 4], second: [B; 4]) -> B {
    let ([a, b, c, d], [e, f, g, h]) = (sorted_four(first), sorted_four(second));
    a.min(h).add(b.min(g)).add(c.min(f).add(d.min(e)))
}

/// The sum of the least half of three costs or more.
#[inline(always)]
fn half_of_all<L: Lane, B: Block<L>, const V: usize>(costs: [B; V]) -> B {
    match costs[..] {
        [a, b, c] => least_two([a, b], c, None),
        [a, b, c, d] => least_two([a, b], c, Some(d)),
        [a, b, c, d, e, f, g, h] => least_four([a, b, c, d], [e, f, g, h]),
        _ => costs[0],
    }
}

/// The mean of the least half of the available costs, on the scale of [`Fusion::scale`]: [`Lane::MAX`], which is
/// `maximum`, where a view is not available, and if none is.
///
/// The costs of single views do not saturate, so a cost is that of an available view if it is below the maximum.
// Not inlined in firmware: it is long, and no profile uses it by default.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn half_of_available<L: Lane, B: Block<L>, const V: usize>(mut costs: [B; V], maximum: B) -> B {
    match &mut costs[..] {
        [a, b, c] => [*a, *b, *c] = sorted_three([*a, *b, *c]),
        [a, b, c, d] => [*a, *b, *c, *d] = sorted_four([*a, *b, *c, *d]),
        [a, b, c, d, e, f, g, h] => {
            [*a, *b, *c, *d, *e, *f, *g, *h] = merged(sorted_four([*a, *b, *c, *d]), sorted_four([*e, *f, *g, *h]));
        }
        _ => {}
    }
    // Beyond the last cost there is none.
    let cost = |k: usize| if k < V { costs[k % V] } else { maximum };
    let twice = |cost: B| cost.add(cost);
    let (one, two) = (cost(0), cost(0).add(cost(1)));
    if V <= 4 {
        let several = maximum.if_greater(cost(2), two, twice(one));
        return maximum.if_greater(one, several, maximum);
    }
    let (three, four) = (two.add(cost(2)), two.add(cost(2)).add(cost(3)));
    let fused = maximum.if_greater(cost(2), six_times(two), six_times(twice(one)));
    let fused = maximum.if_greater(cost(4), twice(twice(three)), fused);
    let fused = maximum.if_greater(cost(6), twice(four).add(four), fused);
    maximum.if_greater(one, fused, maximum)
}
