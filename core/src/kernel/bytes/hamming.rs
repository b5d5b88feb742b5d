//! Matching costs by the census transform: Hamming distances, fused over the views.
#![allow(unsafe_code)]

use core::{ops::Range, ptr};

use bytemuck::{Zeroable, bytes_of, bytes_of_mut};

use super::{ByteVector, Bytes, as_vectors, as_vectors_mut};
use crate::{
    Fusion, Views,
    fusion::{BEYOND_FRAME, hidden, most_doublings},
    infallible,
};

/// The candidates of a pixel in a view, with descriptors of `N` bytes.
#[derive(Clone, Debug)]
pub struct Candidates<'a, const N: usize> {
    /// The bytes of the descriptors, a plane each, from the smallest disparity on and to the end of the last
    /// vector.
    pub planes: [&'a [u8]; N],
    /// The indices of the disparities at which the view is available.
    pub available: Range<u16>,
}

/// The fusion of the Hamming distances of the views in which a candidate is available, rounded down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DistanceFusion {
    /// By a rule.
    Rule(Fusion),
    /// By [`Fusion::Trimmed`] of so many views, of which some may see no candidate.
    Trimmed {
        /// The number of views.
        views: usize,
    },
    /// The [`mean_of_inliers`]: with up to four views, [`Fusion::Mean`].
    Inliers,
}

impl DistanceFusion {
    /// The fusion by a rule of so many views.
    pub const fn new(fusion: Fusion, views: usize) -> DistanceFusion {
        match fusion {
            Fusion::Trimmed => DistanceFusion::Trimmed { views },
            rule => DistanceFusion::Rule(rule),
        }
    }
}

/// The [trimmed](Fusion::Trimmed) mean of the distances in those of `views` that see a candidate, rounded down. 255 of none.
///
/// Sorts the distances.
pub fn trimmed_mean(distances: &mut [u8], views: usize) -> u8 {
    distances.sort_unstable();
    let Some(&least) = distances.first() else { return u8::MAX };
    let mut fused = u32::from(least);
    for doubling in 1..=most_doublings(views) {
        fused = match distances.get(..1 << doubling) {
            Some(kept) => {
                let sum: u32 = kept.iter().copied().map(u32::from).sum();
                (sum >> doubling).min(fused + hidden(doubling))
            }
            None => fused + BEYOND_FRAME,
        };
    }
    fused as u8
}

/// The mean of distances, rounded down: of more than four, without the greatest quarter, which is rounded down. Of several views
/// on one side, all miss what is hidden from there; so the mean says about the same with any number of views. 255 of none.
///
/// Changes the distances.
pub fn mean_of_inliers(distances: &mut [u8]) -> u8 {
    let count = distances.len() as u32;
    let outliers = if count > 4 { count / 4 } else { 0 };
    let mut sum: u32 = distances.iter().copied().map(u32::from).sum();
    for _ in 0..outliers {
        if let Some(greatest) = distances.iter_mut().max() {
            sum -= u32::from(core::mem::take(greatest));
        }
    }
    sum.checked_div(count - outliers).map_or(u8::MAX, |mean| mean as u8)
}

/// The definition of [`PixelLoops::hamming_costs`](super::PixelLoops::hamming_costs).
#[inline(always)]
pub(in crate::kernel) fn hamming_loop<I: Bytes, const N: usize, const V: usize>(
    isa: I,
    fusion: DistanceFusion,
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

impl<const N: usize> Candidates<'_, N> {
    /// No candidates.
    pub const NONE: Self = Candidates { planes: [&[]; N], available: 0..0 };

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

/// The candidates of a run of pixels in a view that is available at all disparities, with descriptors of `N` bytes.
#[derive(Clone, Copy, Debug)]
pub struct CandidateRun<'a, const N: usize> {
    /// The bytes of the descriptors, a plane each.
    pub planes: [&'a [u8]; N],
    /// The index of the first pixel's candidate at the smallest disparity.
    pub first: usize,
    /// From a pixel's candidates to those of the next.
    pub step: isize,
}

impl<'a, const N: usize> CandidateRun<'a, N> {
    /// No candidates.
    pub const NONE: Self = CandidateRun { planes: [&[]; N], first: 0, step: 0 };

    /// The run from pixel `u` on.
    #[inline(always)]
    pub fn from(self, u: usize) -> Self {
        CandidateRun { first: self.first.wrapping_add_signed(self.step.wrapping_mul(u as isize)), ..self }
    }

    /// The first pixel's `depth` candidates. `None` if a plane is too short.
    #[inline(always)]
    pub fn candidates(&self, depth: usize, available: Range<u16>) -> Option<Candidates<'a, N>> {
        let mut planes = self.planes;
        for plane in &mut planes {
            *plane = plane.get(self.first..self.first.wrapping_add(depth))?;
        }
        Some(Candidates { planes, available })
    }

    /// The first pixel's candidates in each plane, if the planes hold `depth` of each of so many pixels.
    fn starts(&self, pixels: usize, depth: usize) -> Option<[*const u8; N]> {
        let steps = isize::try_from(pixels.checked_sub(1)?).ok()?;
        let last = self.first.checked_add_signed(self.step.checked_mul(steps)?)?;
        let end = self.first.max(last).checked_add(depth)?;
        let mut starts = [ptr::null(); N];
        for (start, plane) in starts.iter_mut().zip(self.planes) {
            *start = plane.get(..end)?.as_ptr().wrapping_add(self.first);
        }
        Some(starts)
    }
}

/// [`PixelLoops::hamming_costs`](super::PixelLoops::hamming_costs) of a run of pixels in at most `V` views, by the planes of
/// their `descriptors`. `None`, and nothing is done, if a plane is too short for as many pixels as there are `costs`.
#[inline(always)]
pub fn hamming_run<I: Bytes, const N: usize, const V: usize>(
    isa: I,
    fusion: DistanceFusion,
    descriptors: [&[u8]; N],
    views: &[CandidateRun<'_, N>],
    count: usize,
    costs: &mut [u8],
) -> Option<()> {
    let vectors = infallible::div_ceil(count, I::LANES);
    let depth = vectors * I::LANES;
    let pixels = costs.len().checked_div(depth)?;
    let mut starts = [[ptr::null(); N]; V];
    for (starts, view) in starts.iter_mut().zip(views) {
        *starts = view.starts(pixels, depth)?;
    }
    let mut own = [ptr::null(); N];
    for (own, plane) in own.iter_mut().zip(descriptors) {
        *own = plane.get(..pixels)?.as_ptr();
    }
    let zeroed = <I::Samples as Zeroable>::zeroed();
    // 255 in the lanes past the last disparity.
    let (none, zero) = (isa.splat_byte(u8::MAX), isa.splat_byte(0));
    let past = isa.byte_indices().if_greater(isa.splat_byte(lane_bound(count as u16, depth - I::LANES) - 1), none, zero);
    for (u, costs) in costs.chunks_exact_mut(depth).enumerate() {
        let mut descriptor = [0; N];
        for (byte, own) in descriptor.iter_mut().zip(own) {
            // SAFETY: there is a byte for each pixel in each plane.
            *byte = unsafe { *own.add(u) };
        }
        let costs = as_vectors_mut::<I>(costs);
        for (j, fused) in costs.iter_mut().enumerate() {
            let mut distances = [none; V];
            for ((distances, view), starts) in distances.iter_mut().zip(views).zip(starts) {
                let step = view.step * u as isize;
                let mut others = [&zeroed; N];
                for (others, start) in others.iter_mut().zip(starts) {
                    // SAFETY: each plane has `depth` candidates of each pixel, in whole vectors, which are bytes.
                    *others = unsafe { &*start.wrapping_offset(step).cast::<I::Samples>().wrapping_add(j) };
                }
                *distances = isa.hamming_distances(descriptor, others);
            }
            let costs = fuse(isa, fusion, distances);
            if j + 1 == vectors { costs.max(past) } else { costs }.store(fused);
        }
    }
    Some(())
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
fn fuse<I: Bytes, const V: usize>(isa: I, fusion: DistanceFusion, mut costs: [I::Bytes; V]) -> I::Bytes {
    let none = isa.splat_byte(u8::MAX);
    let fusion = match fusion {
        DistanceFusion::Trimmed { views } => return trimmed(isa, views, costs),
        DistanceFusion::Rule(fusion) => fusion,
        DistanceFusion::Inliers => {
            if V > 4 {
                hide_outliers(isa, &mut costs);
            }
            Fusion::Mean
        }
    };
    match fusion {
        Fusion::Trimmed => trimmed(isa, V, costs),
        Fusion::Min => {
            let mut least = none;
            for cost in costs {
                least = least.min(cost);
            }
            least
        }
        Fusion::Mean if V > 4 => mean_of_many(isa, &costs),
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
        Fusion::Half if V > 8 => {
            sort(&mut costs);
            // A cost is in the least half if there are as many again, but for one.
            keep_followed(isa, &mut costs, 1, |k| 2 * k);
            mean_of_many(isa, &costs)
        }
        Fusion::Heuristic | Fusion::Half => {
            sort(&mut costs);
            // Beyond the last cost there is none.
            let cost = |k: usize| if k < V { costs[k % V] } else { none };
            let (c1, c2, c3) = (cost(0), cost(1), cost(2));
            let two = c1.add(c2);
            let three = two.add(c3);
            if fusion == Fusion::Half {
                let half = none.if_greater(c3, two.halved(), c1);
                let half = none.if_greater(cost(4), three.third(), half);
                return none.if_greater(cost(6), three.add(cost(3)).halved().halved(), half);
            }
            // A third cost that does not exist is above three times any second one, so the rule of two
            // applies. Three that do not exist are left at 255.
            let several = c3.if_greater(c2.add(c2).add(c2), two.halved(), three.third());
            none.if_greater(c2, several, c1)
        }
    }
}

/// The mean of the costs that exist, rounded down.
#[inline(always)]
fn mean_of_many<I: Bytes, const V: usize>(isa: I, costs: &[I::Bytes; V]) -> I::Bytes {
    let (none, zero, one) = (isa.splat_byte(u8::MAX), isa.splat_byte(0), isa.splat_byte(1));
    // A byte holds the sum of eight.
    let mut sums = [<I::Samples as Zeroable>::zeroed(); Views::MAX.div_ceil(8)];
    let (mut means, mut count) = (<I::Samples as Zeroable>::zeroed(), zero);
    for (costs, sums) in costs.chunks(8).zip(&mut sums) {
        let mut sum = zero;
        for &cost in costs {
            sum = sum.add(none.if_greater(cost, cost, zero));
            count = count.add(none.if_greater(cost, one, zero));
        }
        sum.store(sums);
    }
    count.store(&mut means);
    // One by one: there are no lanes that divide by five or seven.
    for (lane, count_to_mean) in bytes_of_mut(&mut means).iter_mut().enumerate() {
        let sums = sums.iter().take(infallible::div_ceil(V, 8));
        let sum: u16 = sums.filter_map(|sum| bytes_of(sum).get(lane)).copied().map(u16::from).sum();
        *count_to_mean = sum.checked_div((*count_to_mean).into()).map_or(u8::MAX, |mean| mean as u8);
    }
    isa.load_bytes(&means)
}

/// The costs of `views` fused by [`Fusion::Trimmed`].
#[inline(always)]
fn trimmed<I: Bytes, const V: usize>(isa: I, views: usize, mut costs: [I::Bytes; V]) -> I::Bytes {
    sort(&mut costs);
    let none = isa.splat_byte(u8::MAX);
    let bits = |bits: u32| isa.splat_byte(bits as u8);
    let (mut sum, mut fused) = (costs[0], costs[0]);
    for doubling in 1..=most_doublings(V).min(most_doublings(views)) {
        let count = 1 << doubling;
        let mut others = isa.splat_byte(0);
        for &cost in costs.iter().take(count).skip(count / 2) {
            others = others.add(cost);
        }
        // A byte holds the sum of eight: that of sixteen is halved at once.
        let mut mean = if count > 8 { average(isa, sum, others) } else { sum.add(others) };
        for _ in 0..doubling - u32::from(count > 8) {
            mean = mean.halved();
        }
        sum = sum.add(others);
        let trimmed = mean.min(fused.add(bits(hidden(doubling))));
        fused = none.if_greater(costs[(count - 1) % V], trimmed, fused.add(bits(BEYOND_FRAME)));
    }
    fused
}

/// The means of two costs, rounded down.
#[inline(always)]
fn average<I: Bytes>(isa: I, a: I::Bytes, b: I::Bytes) -> I::Bytes {
    let is_odd = |cost: I::Bytes| cost.sub(cost.halved()).sub(cost.halved());
    let both = is_odd(a).min(is_odd(b)).min(isa.splat_byte(1));
    a.halved().add(b.halved()).add(both)
}

/// Sorts costs, and hides those that are not among the [inliers](mean_of_inliers).
#[inline(always)]
fn hide_outliers<I: Bytes, const V: usize>(isa: I, costs: &mut [I::Bytes; V]) {
    sort(costs);
    // Of five to seven costs the last is an outlier, of eight to eleven the last two, and so on.
    keep_followed(isa, costs, 4, |k| k + k / 3);
}

/// Hides sorted costs, from the index `first` on, unless there are as many costs as `last(index)` is the index of the last.
#[inline(always)]
fn keep_followed<I: Bytes, const V: usize>(isa: I, costs: &mut [I::Bytes; V], first: usize, last: impl Fn(usize) -> usize) {
    let none = isa.splat_byte(u8::MAX);
    for k in first..V {
        let last = costs.get(last(k)).copied().unwrap_or(none);
        costs[k] = none.if_greater(last, costs[k], none);
    }
}

/// An exchange sort; of many costs the merge exchange of Batcher (1968), as in Knuth's algorithm 5.2.2M.
#[inline(always)]
fn sort<B: ByteVector, const V: usize>(costs: &mut [B; V]) {
    if V <= 8 {
        for i in 0..V {
            for j in i + 1..V {
                exchange(costs, i, j);
            }
        }
        return;
    }
    let greatest = const { V.next_power_of_two() / 2 };
    let mut p = greatest;
    while p > 0 {
        let (mut q, mut r, mut distance) = (greatest, 0, p);
        loop {
            for i in (0..V - distance).filter(|i| i & p == r) {
                exchange(costs, i, i + distance);
            }
            if q == p {
                break;
            }
            (distance, q, r) = (q - p, q / 2, p);
        }
        p /= 2;
    }
}

/// Orders two of the costs.
#[inline(always)]
fn exchange<B: ByteVector, const V: usize>(costs: &mut [B; V], i: usize, j: usize) {
    (costs[i], costs[j]) = (costs[i].min(costs[j]), costs[i].max(costs[j]));
}
