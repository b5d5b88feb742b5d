//! Matching costs by the census transform: Hamming distances, fused over the views.

use core::ops::Range;

use bytemuck::Zeroable;

use super::lanes::{ByteVector, Bytes, as_vectors};
use crate::Fusion;

/// The candidates of a pixel in a view, with descriptors of `N` bytes. By default there are none.
#[derive(Clone, Debug)]
pub struct Candidates<'a, const N: usize> {
    /// The bytes of the descriptors, a plane each, from the smallest disparity on and to the end of the last
    /// vector.
    pub planes: [&'a [u8]; N],
    /// The indices of the disparities at which the view is available.
    pub available: Range<u16>,
}

/// The definition of [`PixelLoops::hamming_costs`](super::PixelLoops::hamming_costs).
#[inline(always)]
pub(in crate::kernel) fn hamming_loop<I: Bytes, const N: usize, const V: usize>(
    isa: I,
    fusion: Fusion,
    descriptor: [u8; N],
    views: &[Candidates<'_, N>; V],
    count: usize,
    costs: &mut [I::Samples],
) {
    let none = isa.splat_byte(u8::MAX);
    for (j, fused) in costs.iter_mut().enumerate() {
        let mut distances = [none; V];
        for (distances, view) in distances.iter_mut().zip(views) {
            *distances = view.distances(isa, descriptor, j, count);
        }
        fuse(isa, fusion, distances).store(fused);
    }
}

impl<const N: usize> Default for Candidates<'_, N> {
    fn default() -> Self {
        Candidates { planes: [&[]; N], available: 0..0 }
    }
}

impl<const N: usize> Candidates<'_, N> {
    /// The distances in the `j`-th vector of `count` disparities.
    #[inline(always)]
    fn distances<I: Bytes>(&self, isa: I, descriptor: [u8; N], j: usize, count: usize) -> I::Bytes {
        let first = j * I::LANES;
        let none = isa.splat_byte(u8::MAX);
        let zero = <I::Samples as Zeroable>::zeroed();
        let mut others = [&zero; N];
        for (others, plane) in others.iter_mut().zip(self.planes) {
            let Some(bytes) = plane.get(first..first + I::LANES) else { return none };
            let Some(samples) = as_vectors::<I>(bytes).first() else { return none };
            *others = samples;
        }
        let distances = isa.hamming_distances(descriptor, others);
        let Range { start, end } = self.available;
        if start == 0 && usize::from(end) == count && first + I::LANES <= count {
            return distances;
        }
        let (start, end) = (isa.splat_byte(lane_bound(start, first)), isa.splat_byte(lane_bound(end, first)));
        let indices = isa.byte_indices();
        start.if_greater(indices, none, end.if_greater(indices, distances, none))
    }
}

/// The lane of a disparity in the vector that begins at `first`. Lanes are fewer than 255, so that bounds beyond
/// them may be cut.
#[inline(always)]
fn lane_bound(index: u16, first: usize) -> u8 {
    usize::from(index).saturating_sub(first).min(254) as u8
}

/// The rules of [`Fusion::fuse`] in lanes, rounded down. A cost that does not exist is 255, and all others are
/// at most [`Census::MAX_BITS`](crate::Census::MAX_BITS).
#[inline(always)]
fn fuse<I: Bytes, const V: usize>(isa: I, fusion: Fusion, mut costs: [I::Bytes; V]) -> I::Bytes {
    let none = isa.splat_byte(u8::MAX);
    match fusion {
        Fusion::Min => {
            let mut least = none;
            for cost in costs {
                least = least.min(cost);
            }
            least
        }
        Fusion::Mean => {
            let (zero, one) = (isa.splat_byte(0), isa.splat_byte(1));
            let (mut sum, mut count) = (zero, zero);
            for cost in costs {
                sum = sum.add(none.if_greater(cost, cost, zero));
                count = count.add(none.if_greater(cost, one, zero));
            }
            let mean = count.if_greater(zero, sum, none);
            let mean = count.if_greater(one, sum.halved(), mean);
            let mean = count.if_greater(isa.splat_byte(2), sum.third(), mean);
            count.if_greater(isa.splat_byte(3), sum.halved().halved(), mean)
        }
        Fusion::Heuristic => {
            // An exchange sort.
            for i in 0..V {
                for j in i + 1..V {
                    (costs[i], costs[j]) = (costs[i].min(costs[j]), costs[i].max(costs[j]));
                }
            }
            let c1 = costs[0];
            let c2 = if V > 1 { costs[1 % V] } else { none };
            let c3 = if V > 2 { costs[2 % V] } else { none };
            let two = c1.add(c2);
            // A third cost that does not exist is above three times any second one, so the rule of two
            // applies. Three that do not exist are left at 255.
            let several = c3.if_greater(c2.add(c2).add(c2), two.halved(), two.add(c3).third());
            none.if_greater(c2, several, c1)
        }
    }
}
