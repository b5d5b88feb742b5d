//! Costs in 8-bit lanes.
#![allow(unsafe_code)]

use super::{
    Mve, TWIN,
    pixel::{self, AT_ONCE, MOST_PATHS},
    runs, slide,
};
use crate::{
    Fusion,
    kernel::{
        blocks::Blocks,
        bytes::{
            BackwardRun, Bytes, Candidates, DistanceFusion, Divisor, ForwardRun, PixelLoops, PixelPaths, RunLoops, Slot, Step,
            hamming_loop,
        },
        rule::Rule,
        steps::Steps,
    },
};

impl Bytes for Mve {
    type Bytes = [u8; 8];

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 8]) -> [u8; 8] {
        *costs
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> [u8; 8] {
        [cost; 8]
    }

    #[inline(always)]
    fn byte_indices(self) -> [u8; 8] {
        TWIN.byte_indices()
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 8]; N]) -> [u8; 8] {
        pixel::distances(descriptor, others)
    }
}

impl PixelLoops for Mve {
    #[inline(always)]
    fn hamming_costs<const N: usize, const V: usize>(
        self,
        fusion: DistanceFusion,
        descriptor: [u8; N],
        views: &[Candidates<'_, N>; V],
        count: usize,
        costs: &mut [[u8; 8]],
    ) {
        if fusion != DistanceFusion::Rule(Fusion::Min) || N > 4 {
            return hamming_loop(self, fusion, descriptor, views, count, costs);
        }
        let costs = costs.as_flattened_mut();
        costs.fill(u8::MAX);
        for Candidates { planes, available } in views {
            let range = usize::from(available.start)..usize::from(available.end);
            let planes = planes.map(|plane| plane.get(range.clone()).unwrap_or_default());
            let costs = costs.get_mut(range).unwrap_or_default();
            if !costs.is_empty() && planes.iter().all(|plane| plane.len() == costs.len()) {
                // SAFETY: there are as many bytes in each plane as costs, not 0, and at most four planes.
                unsafe { pixel::lower(descriptor, planes, costs) }
            }
        }
    }

    #[inline(always)]
    fn divide(self, Divisor { shift, by_three }: Divisor, sums: &[[u16; 8]], quotients: &mut [u8]) {
        let vectors = sums.len().min(quotients.len() / 8);
        let (Some(sums), Some(quotients)) = (sums.get(..vectors), quotients.get_mut(..8 * vectors)) else { return };
        if sums.is_empty() {
            return;
        }
        // SAFETY: there are as many quotients as sums, not 0.
        unsafe {
            match by_three {
                false => pixel::divide::<false>(shift, sums, quotients),
                true => pixel::divide::<true>(shift, sums, quotients),
            }
        }
    }

    #[inline(always)]
    fn slide_and_divide<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        divisor: Divisor,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[[u16; 8]; V]],
        masks: &[[[u16; 8]; V]],
        fused: &mut [[u16; 8]],
        quotients: &mut [u8],
    ) {
        let suits = slide::suits(rule, steps, blocks, masks) && !divisor.by_three;
        if const { V != 4 } || !suits || quotients.len() != 32 {
            Blocks::<u16>::slide_and_fuse(self, rule, masked, steps, blocks, masks, fused);
            return self.divide(divisor, fused, quotients);
        }
        let Some(step) = steps.next_raw() else { return };
        // SAFETY: there are four views, four vectors of each, and 32 quotients.
        unsafe { by_mask!(masked, slide::slide_to_quotients::<V>(step, blocks, masks, divisor.shift, quotients)) }
    }

    #[inline(always)]
    fn extend<const N: usize, const FIRST: bool>(self, costs: &[[u8; 8]], steps: [Step<'_>; N], p1: u8, excess: &mut [[u8; 8]]) {
        let (costs, excess) = (costs.as_flattened(), excess.as_flattened_mut());
        let slot = Slot::bytes(costs.len());
        let fits = |step: &Step<'_>| step.before.len() == slot && step.after.len() == slot;
        if costs.is_empty() || costs.len() != excess.len() || !steps.iter().all(fits) {
            return;
        }
        for (k, step) in steps.into_iter().enumerate() {
            // SAFETY: there are as many costs as excess, and the slots fit them.
            unsafe {
                match FIRST && k == 0 {
                    true => pixel::extend::<true>(costs, step, p1, excess),
                    false => pixel::extend::<false>(costs, step, p1, excess),
                }
            }
        }
    }

    #[inline(always)]
    fn winner(self, paths: u16, costs: &[[u8; 8]], excess: &[[u8; 8]]) -> (u16, usize) {
        if paths > MOST_PATHS {
            return TWIN.winner(paths, costs, excess);
        }
        let (costs, excess) = (costs.as_flattened().chunks(AT_ONCE), excess.as_flattened().chunks(AT_ONCE));
        let mut winner = (u16::MAX, 0);
        for (j, (costs, excess)) in costs.zip(excess).enumerate().filter(|(_, (costs, excess))| costs.len() == excess.len()) {
            // SAFETY: chunks are not empty, and have as many costs as excess.
            let (least, index) = pixel::unpack(unsafe { pixel::least(paths, costs, excess) });
            if least < winner.0 {
                winner = (least, AT_ONCE * j + index);
            }
        }
        winner
    }
}

impl RunLoops for Mve {
    #[inline(always)]
    fn extend_forward(self, run: ForwardRun<'_, '_>) {
        runs::forward(self, run);
    }

    #[inline(always)]
    fn extend_backward(self, paths: u16, run: BackwardRun<'_, '_>, reach: impl FnMut(PixelPaths<'_>)) {
        runs::backward(self, paths, run, reach);
    }
}
