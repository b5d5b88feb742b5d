//! The loops over costs in 8-bit lanes: through the disparities of a pixel, and along paths through many pixels.

use crate::infallible;
use core::slice;

use super::{
    Bytes, Divisor, as_vectors, as_vectors_mut,
    hamming::{Candidates, DistanceFusion, hamming_loop},
    paths::{Slot, Step, extend_loop},
};
use crate::kernel::{blocks::Blocks, rule::Rule, steps::Steps};

/// The loops over the 8-bit costs of a pixel.
///
/// The provided loops are their definition. An instruction set that overrides one computes the same.
pub trait PixelLoops: Bytes {
    /// Fuses the Hamming distances of a pixel's `descriptor` to the candidates of `V` views, rounded down. Costs past
    /// the last of `count` disparities are 255.
    #[inline(always)]
    fn hamming_costs<const N: usize, const V: usize>(
        self,
        fusion: DistanceFusion,
        descriptor: [u8; N],
        views: &[Candidates<'_, N>; V],
        count: usize,
        costs: &mut [Self::Samples],
    ) {
        hamming_loop(self, fusion, descriptor, views, count, costs);
    }

    /// Divides fused sums to matching costs, in the order of the disparities. `quotients` are as many.
    #[inline(always)]
    fn divide(self, divisor: Divisor, sums: &[<Self as Blocks<u16>>::Costs], quotients: &mut [u8]) {
        for (sums, quotients) in sums.iter().zip(quotients.chunks_exact_mut(Self::LANES)) {
            let lanes: &[u16] = bytemuck::try_cast_slice(slice::from_ref(sums)).unwrap_or_default();
            for (index, quotient) in quotients.iter_mut().enumerate() {
                *quotient = divisor.divide(lanes.get(Self::lane(index)).copied().unwrap_or(u16::MAX));
            }
        }
    }

    /// [`slide_and_fuse`](Blocks::slide_and_fuse) and [`divide`](PixelLoops::divide). The fused sums are only a
    /// buffer.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "those of both operations")]
    fn slide_and_divide<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        divisor: Divisor,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[<Self as Blocks<u16>>::Costs; V]],
        masks: &[[<Self as Blocks<u16>>::Costs; V]],
        fused: &mut [<Self as Blocks<u16>>::Costs],
        quotients: &mut [u8],
    ) {
        Blocks::<u16>::slide_and_fuse(self, rule, masked, steps, blocks, masks, fused);
        self.divide(divisor, fused, quotients);
    }

    /// Extends paths by a pixel with these `costs`.
    ///
    /// The excess of the paths over the costs, at most [`PathPenalties::MAX`](crate::PathPenalties::MAX) each, is
    /// written to `excess` if `FIRST` is set, and added to it otherwise.
    #[inline(always)]
    fn extend<const N: usize, const FIRST: bool>(
        self,
        costs: &[Self::Samples],
        steps: [Step<'_>; N],
        p1: u8,
        excess: &mut [Self::Samples],
    ) {
        extend_loop::<Self, N, FIRST>(self, costs, steps, p1, excess);
    }

    /// The least of `paths`, at most 127, times the cost plus the excess, over all lanes, and the index of the
    /// first lane that has it.
    #[inline(always)]
    fn winner(self, paths: u16, costs: &[Self::Samples], excess: &[Self::Samples]) -> (u16, usize) {
        let (costs, excess): (&[u8], &[u8]) = (infallible::cast(costs), infallible::cast(excess));
        let sums = || costs.iter().zip(excess).map(|(&cost, &excess)| paths * u16::from(cost) + u16::from(excess));
        let least = sums().fold(u16::MAX, u16::min);
        (least, sums().position(|sum| sum == least).unwrap_or_default())
    }
}

/// The penalties of paths for changes of disparity along a run.
#[derive(Clone, Copy, Debug)]
pub struct RunPenalties<'a> {
    /// The penalty of a change by one disparity.
    pub p1: u8,
    /// The penalty of a larger change by the change of brightness, from 0 to 255. It never rises.
    pub p2: &'a [u8],
    /// The centre's samples in the line.
    pub here: &'a [u8],
    /// The centre's samples in the line above.
    pub above: &'a [u8],
}

/// A run of pixels for the paths from the left and from above.
#[derive(Debug)]
pub struct ForwardRun<'a, 'm> {
    /// The column of the first pixel.
    pub start: usize,
    /// The disparities of a pixel.
    pub depth: usize,
    /// The matching costs, pixel by pixel.
    pub costs: &'a [u8],
    /// The excess of the paths over them, to be written.
    pub excess: &'a mut [u8],
    /// Two [slots](Slot) of the path from the left. Before and after the call, the first is that of the last
    /// pixel so far.
    pub along: &'a mut [&'m mut [u8]; 2],
    /// The slots of the paths from the top left, the top and the top right: one for each pixel and one more.
    /// Each pixel's path is read from the next slot.
    pub from_above: [&'a mut [u8]; 3],
    /// The penalties.
    pub penalties: RunPenalties<'a>,
}

/// A run of pixels for the path from the right.
#[derive(Debug)]
pub struct BackwardRun<'a, 'm> {
    /// The disparities of a pixel.
    pub depth: usize,
    /// The matching costs, pixel by pixel.
    pub costs: &'a [u8],
    /// The excess of the paths over them, to be added to.
    pub excess: &'a mut [u8],
    /// Two slots of the path, the first that of the last pixel so far.
    pub along: &'a mut [&'m mut [u8]; 2],
    /// The penalties.
    pub penalties: RunPenalties<'a>,
}

/// A pixel to which all paths lead.
#[derive(Clone, Copy, Debug)]
pub struct PixelPaths<'a> {
    /// The column.
    pub column: usize,
    /// The matching costs.
    pub costs: &'a [u8],
    /// The excess of the paths over them.
    pub excess: &'a [u8],
    /// The result of [`PixelLoops::winner`].
    pub winner: (u16, usize),
}

impl RunPenalties<'_> {
    /// The penalty P2 if the brightness does not matter.
    pub fn constant_p2(&self) -> Option<u8> {
        self.p2.first().copied().filter(|first| self.p2.last() == Some(first))
    }

    /// The penalties P2 of the paths from the left, the top left, the top and the top right to column `u`.
    #[inline(always)]
    pub(crate) fn forward_p2(&self, u: usize) -> [u8; 4] {
        let RunPenalties { here, above, .. } = self;
        let before = u.wrapping_sub(1);
        [here.get(before), above.get(before), above.get(u), above.get(u + 1)].map(|other| self.p2(here.get(u), other))
    }

    /// The penalty P2 of the path from the right to column `u`.
    #[inline(always)]
    pub(in crate::kernel) fn backward_p2(&self, u: usize) -> u8 {
        self.p2(self.here.get(u), self.here.get(u + 1))
    }

    /// The penalty P2 between samples, or any if there is none: a path begins.
    #[inline(always)]
    fn p2(&self, one: Option<&u8>, other: Option<&u8>) -> u8 {
        let change = one.zip(other).map_or(0, |(one, &other)| one.abs_diff(other));
        self.p2.get(usize::from(change)).copied().unwrap_or_default()
    }
}

/// The loops over runs of pixels.
///
/// The provided loops are their definition. An instruction set that overrides one computes the same.
pub trait RunLoops: PixelLoops {
    /// Extends the paths from the left and from above through a run of pixels.
    #[inline(always)]
    fn extend_forward(self, run: ForwardRun<'_, '_>) {
        forward_loop(self, run);
    }

    /// Extends the path from the right through a whole line, and hands over each pixel with its
    /// [winner](PixelLoops::winner), in any order.
    #[inline(always)]
    fn extend_backward(self, paths: u16, run: BackwardRun<'_, '_>, reach: impl FnMut(PixelPaths<'_>)) {
        backward_loop(self, paths, run, reach);
    }
}

/// The definition of [`RunLoops::extend_forward`].
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
pub(in crate::kernel) fn forward_loop<I: PixelLoops>(isa: I, run: ForwardRun<'_, '_>) {
    let ForwardRun { start, depth, costs, excess, along, mut from_above, penalties } = run;
    let stride = Slot::bytes(depth);
    for (i, (costs, excess)) in costs.chunks_exact(depth.max(1)).zip(excess.chunks_exact_mut(depth.max(1))).enumerate() {
        let [p2, p2_a, p2_b, p2_c] = penalties.forward_p2(start + i);
        let [before, after] = &mut *along;
        let from_left = Step { before, after, p2 };
        let [a, b, c] = from_above.each_mut().map(|slots| {
            let slots = slots.get_mut(i * stride..(i + 2) * stride).unwrap_or_default();
            slots.split_at_mut_checked(stride).unwrap_or_default()
        });
        let [a, b, c] = [(a, p2_a), (b, p2_b), (c, p2_c)].map(|((after, before), p2)| Step { before, after, p2 });
        isa.extend::<4, true>(as_vectors::<I>(costs), [from_left, a, b, c], penalties.p1, as_vectors_mut::<I>(excess));
        along.reverse();
    }
}

/// The definition of [`RunLoops::extend_backward`].
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
pub(in crate::kernel) fn backward_loop<I: PixelLoops>(
    isa: I,
    paths: u16,
    run: BackwardRun<'_, '_>,
    mut reach: impl FnMut(PixelPaths<'_>),
) {
    let BackwardRun { depth, costs, excess, along, penalties } = run;
    let pixels = costs.chunks_exact(depth.max(1)).zip(excess.chunks_exact_mut(depth.max(1)));
    for (column, (costs, excess)) in pixels.enumerate().rev() {
        let [before, after] = &mut *along;
        let from_right = Step { before, after, p2: penalties.backward_p2(column) };
        isa.extend::<1, false>(as_vectors::<I>(costs), [from_right], penalties.p1, as_vectors_mut::<I>(excess));
        along.reverse();
        let winner = isa.winner(paths, as_vectors::<I>(costs), as_vectors::<I>(excess));
        reach(PixelPaths { column, costs, excess, winner });
    }
}

/// An instruction set with every operation of the matchers.
pub trait Kernel: RunLoops {}

impl<I: RunLoops> Kernel for I {}
