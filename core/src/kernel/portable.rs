//! Plain Rust over arrays: the definition of every operation.

use super::{
    blocks::{Blocks, fuse_loop, fuse_masked_loop, slide_loop},
    bytes::{ByteVector, Bytes, PixelLoops, RunLoops},
    isa::{Block, Change, Column, Isa, Lane, sealed::Sealed},
    rule::Rule,
    steps::Steps,
};
use crate::infallible;

/// No instruction set in particular: arrays of `N` lanes, and batches of `B` pixels.
///
/// Every other instruction set is compared with the one that has as many lanes and batches as large.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable<const N: usize, const B: usize = 1>;

/// The vector of which `lane` gives each lane. A loop is less to compile than `array::from_fn`.
#[inline(always)]
fn lanes<T: Copy + Default, const N: usize>(mut lane: impl FnMut(usize) -> T) -> [T; N] {
    let mut lanes = [T::default(); N];
    let mut i = 0;
    while i < N {
        lanes[i] = lane(i);
        i += 1;
    }
    lanes
}

impl<const N: usize, const B: usize> Sealed for Portable<N, B> {}

impl<const N: usize, const B: usize> Isa for Portable<N, B> {
    const LANES: usize = N;
    const BATCH: usize = B;
    type Samples = [u8; N];
    type Sums = [u16; N];
    type Column = [u16; N];

    #[inline(always)]
    fn load_column(self, sums: &[u16; N]) -> [u16; N] {
        *sums
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; N]) -> [u16; N] {
        // In bytes, then widened: twice as many fit a register.
        lanes(|i| u16::from(center.max(view[i]) - center.min(view[i])))
    }

    #[inline(always)]
    fn advance(self, sums: [u16; N], center: Change<u8>, view: Change<&[u8; N]>) -> [u16; N] {
        let (entering, leaving) =
            (self.differences(center.entering, view.entering), self.differences(center.leaving, view.leaving));
        lanes(|i| sums[i].wrapping_add(entering[i]).wrapping_sub(leaving[i]))
    }
}

impl<const N: usize> Column for [u16; N] {
    type Sums = [u16; N];

    #[inline(always)]
    fn store(self, sums: &mut [u16; N]) {
        *sums = self;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        lanes(|i| self[i].wrapping_add(other[i]))
    }
}

/// True on microcontrollers: those without a kernel of their own have few registers and no vectors, so that loops go from lane to
/// lane.
const LANE_BY_LANE: bool = cfg!(target_os = "none");

/// True where, besides, lanes of 16 bits are added in pairs, as one number of 32 bits whose lower half comes first in memory.
const IN_PAIRS: bool = LANE_BY_LANE && cfg!(target_endian = "little");

/// [`slide_loop`] in pairs of lanes, of which `blocks` has one in a word. The sums are aligned to words.
///
/// Sums of pairs are exact: no sum of a candidate leaves 16 bits, and a carry out of a lane past the last disparity reaches no
/// candidate, since none comes after it.
#[inline(always)]
fn slide_pairs<const N: usize, const B: usize, const V: usize>(steps: &mut Steps<'_, Portable<N, B>, V>, blocks: &mut [u32]) {
    let Some(step) = steps.next() else { return };
    let Change { entering: center, leaving: center_leaving } = step.center;
    let growth =
        |entering: u8, leaving: u8| u32::from(center.abs_diff(entering)).wrapping_sub(center_leaving.abs_diff(leaving).into());
    let (columns, leaving_columns) = (infallible::cast_mut(step.entering), infallible::cast(step.leaving));
    let words = step.vectors * (N / 2);
    each_view!(k, {
        let of_view = k * words..(k + 1) * words;
        let column: &mut [u32] = columns.get_mut(of_view.clone()).unwrap_or_default();
        let leaving_column: &[u32] = leaving_columns.get(of_view).unwrap_or_default();
        let samples = step.views[k].entering.iter().zip(step.views[k].leaving);
        let vectors = column.chunks_exact_mut(N / 2).zip(leaving_column.chunks_exact(N / 2));
        for (((sums, leaving_sums), block), (entering, leaving)) in vectors.zip(blocks.chunks_exact_mut(V * (N / 2))).zip(samples)
        {
            let block = block.iter_mut().skip(k * (N / 2));
            for (i, ((sum, leaving_sum), block)) in sums.iter_mut().zip(leaving_sums).zip(block).enumerate() {
                let [first, second] = [2 * i, 2 * i + 1].map(|lane| growth(entering[lane], leaving[lane]));
                *sum = sum.wrapping_add(first).wrapping_add(second << 16);
                *block = block.wrapping_add(*sum).wrapping_sub(*leaving_sum);
            }
        }
    });
}

/// [`fuse_loop`], or [`fuse_masked_loop`] if `MASKED`, lane by lane.
#[inline(always)]
fn fuse_lanes<L: Lane, const N: usize, const V: usize, const MASKED: bool>(
    rule: Rule,
    blocks: &[[[L; N]; V]],
    masks: &[[[L; N]; V]],
    fused: &mut [[L; N]],
) -> L
where
    [L; 1]: Block<L, Costs = [L; 1]>,
{
    let (mut least, mut masks) = (L::MAX, masks.iter());
    for (fused, block) in fused.iter_mut().zip(blocks) {
        let mask = masks.next().filter(|_| MASKED).unwrap_or(block);
        for i in 0..N {
            let mut costs = [[L::MAX]; V];
            each_view!(k, { costs[k] = [block[k][i].max(mask[k][i])] });
            let [cost] = if MASKED { rule.fuse_masked(costs, [L::MAX]) } else { rule.fuse(costs) };
            fused[i] = cost;
            least = least.min(cost);
        }
    }
    least
}

macro_rules! blocks {
    ($lane:ty, $add:ident) => {
        impl<const N: usize, const B: usize> Blocks<$lane> for Portable<N, B> {
            const IN_REGISTERS: bool = B > 1;
            type Costs = [$lane; N];
            type Block = [$lane; N];

            #[inline(always)]
            fn load_block(self, costs: &[$lane; N]) -> [$lane; N] {
                *costs
            }

            #[inline(always)]
            fn splat(self, cost: $lane) -> [$lane; N] {
                [cost; N]
            }

            #[inline(always)]
            fn position(self, costs: &[[$lane; N]], cost: $lane) -> usize {
                let lanes = costs.as_flattened();
                lanes.iter().position(|&lane| lane == cost).unwrap_or(lanes.len())
            }

            #[inline(always)]
            fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[$lane; N]; V]], fused: &mut [[$lane; N]]) -> $lane {
                match LANE_BY_LANE {
                    true => fuse_lanes::<$lane, N, V, false>(rule, blocks, &[], fused),
                    false => fuse_loop::<$lane, Self, V>(self, rule, blocks, fused),
                }
            }

            #[inline(always)]
            fn fuse_masked<const V: usize>(
                self,
                rule: Rule,
                masked: u8,
                blocks: &[[[$lane; N]; V]],
                masks: &[[[$lane; N]; V]],
                fused: &mut [[$lane; N]],
            ) -> $lane {
                match masked {
                    0 => Blocks::<$lane>::fuse(self, rule, blocks, fused),
                    _ if LANE_BY_LANE => fuse_lanes::<$lane, N, V, true>(rule, blocks, masks, fused),
                    _ => fuse_masked_loop::<$lane, Self, V>(self, rule, blocks, masks, fused),
                }
            }

            #[inline(always)]
            fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[$lane; N]; V]]) {
                let words = if IN_PAIRS && steps.are_words() { infallible::cast_mut(&mut *blocks) } else { &mut [] };
                match size_of::<$lane>() == size_of::<u16>() && !words.is_empty() {
                    true => slide_pairs(steps, words),
                    false => slide_loop::<$lane, Self, V>(self, steps, blocks),
                }
            }
        }

        impl<const N: usize> Block<$lane> for [$lane; N] {
            type Costs = [$lane; N];
            type Column = [u16; N];

            #[inline(always)]
            fn store(self, costs: &mut [$lane; N]) {
                *costs = self;
            }

            #[inline(always)]
            fn slide(self, entering: [u16; N], leaving: [u16; N]) -> Self {
                lanes(|i| self[i].wrapping_add(entering[i].wrapping_sub(leaving[i]) as i16 as $lane))
            }

            #[inline(always)]
            fn add(self, other: Self) -> Self {
                lanes(|i| self[i].$add(other[i]))
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                lanes(|i| self[i].min(other[i]))
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                lanes(|i| self[i].max(other[i]))
            }

            #[inline(always)]
            fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
                lanes(|i| if self[i] > other[i] { then[i] } else { otherwise[i] })
            }

            #[inline(always)]
            fn least(self) -> $lane {
                self.into_iter().fold(<$lane>::MAX, <$lane>::min)
            }
        }
    };
}

blocks!(u16, saturating_add);
blocks!(u32, wrapping_add);

impl<const N: usize, const B: usize> Bytes for Portable<N, B> {
    type Bytes = [u8; N];

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; N]) -> [u8; N] {
        *costs
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> [u8; N] {
        [cost; N]
    }

    #[inline(always)]
    fn byte_indices(self) -> [u8; N] {
        lanes(|i| i as u8)
    }

    #[inline(always)]
    fn hamming_distances<const M: usize>(self, descriptor: [u8; M], others: [&[u8; N]; M]) -> [u8; N] {
        let mut distances = [0; N];
        for (byte, others) in descriptor.into_iter().zip(others) {
            for (distance, other) in distances.iter_mut().zip(others) {
                *distance += (byte ^ other).count_ones() as u8;
            }
        }
        distances
    }
}

impl<const N: usize, const B: usize> PixelLoops for Portable<N, B> {}

impl<const N: usize, const B: usize> RunLoops for Portable<N, B> {}

impl<const N: usize> ByteVector for [u8; N] {
    type Memory = [u8; N];

    #[inline(always)]
    fn store(self, costs: &mut [u8; N]) {
        *costs = self;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        lanes(|i| self[i].saturating_add(other[i]))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        lanes(|i| self[i].saturating_sub(other[i]))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        lanes(|i| self[i].min(other[i]))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        lanes(|i| self[i].max(other[i]))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        lanes(|i| if self[i] > other[i] { then[i] } else { otherwise[i] })
    }

    #[inline(always)]
    fn halved(self) -> Self {
        lanes(|i| self[i] / 2)
    }

    #[inline(always)]
    fn third(self) -> Self {
        lanes(|i| self[i] / 3)
    }

    #[inline(always)]
    fn least(self) -> u8 {
        self.into_iter().fold(u8::MAX, u8::min)
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        [self.least(); N]
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        lanes(|i| if i == 0 { previous[N - 1] } else { self[i - 1] })
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        lanes(|i| if i == N - 1 { next[0] } else { self[i + 1] })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::kernel::Samples;
    use std::{vec, vec::Vec};

    const VIEWS: usize = 3;

    /// Marsaglia's xorshift.
    fn numbers(mut state: u32) -> impl FnMut() -> u32 {
        move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        }
    }

    #[test]
    fn bytes_move_between_vectors() {
        assert_eq!([1, 2, 3, 4].moved_up([5, 6, 7, 8]), [8, 1, 2, 3]);
        assert_eq!([1, 2, 3, 4].moved_down([5, 6, 7, 8]), [2, 3, 4, 5]);
        assert_eq!([4, 2, 3, 9].least_in_each(), [2; 4]);
    }

    /// Slides blocks of 11 columns along a line, in which the sums of each column grow and fall as they do over 11 lines.
    #[test]
    fn pairs_of_lanes_slide_as_lanes_do() {
        let (mut number, depth, columns, block) = (numbers(1), 24, 40, 11);
        let mut samples = |count: usize| (0..count).map(|_| [0, 255, number() as u8][number() as usize % 3]).collect::<Vec<u8>>();
        let lines: Vec<[Vec<u8>; 1 + VIEWS]> =
            (0..30).map(|_| [columns, columns + depth, columns + depth, columns + depth].map(&mut samples)).collect();
        let line = |v: usize, frame: usize, depth: usize| Samples { memory: &lines[v][frame], start: 0, step: 1, depth };
        let empty = vec![[0; 8]; VIEWS * 3];
        // Words, so that the sums are aligned to them.
        let mut words = [vec![0u32; columns * VIEWS * depth / 2], vec![0; columns * VIEWS * depth / 2]];
        let [in_lanes, in_pairs] = &mut words;
        for v in 0..lines.len() {
            let leaving = v.checked_sub(block);
            let change =
                |frame, depth| Change { entering: line(v, frame, depth), leaving: line(leaving.unwrap_or(v), frame, depth) };
            if leaving.is_none() {
                // The block is not full yet: a line enters and none leaves.
                for sums in [&mut *in_lanes, &mut *in_pairs] {
                    let sums = infallible::cast_mut(sums);
                    let mut steps =
                        Steps::<Portable<8>, VIEWS>::new(change(0, 1), [1, 2, 3].map(|k| change(k, depth)), sums, &empty, block);
                    (0..columns).for_each(|_| Blocks::<u16>::prime(Portable::<8>, &mut steps));
                }
                continue;
            }
            let (mut blocks, mut pairs) = ([[[0u16; 8]; VIEWS]; 3], [0u32; VIEWS * 12]);
            let steps =
                |sums| Steps::<Portable<8>, VIEWS>::new(change(0, 1), [1, 2, 3].map(|k| change(k, depth)), sums, &empty, block);
            let (mut steps_in_lanes, mut steps_in_pairs) =
                (steps(infallible::cast_mut(in_lanes)), steps(infallible::cast_mut(in_pairs)));
            assert!(steps_in_pairs.are_words());
            for u in 0..columns {
                slide_loop::<u16, _, VIEWS>(Portable, &mut steps_in_lanes, &mut blocks);
                slide_pairs(&mut steps_in_pairs, &mut pairs);
                assert_eq!(bytemuck::cast_slice::<_, u16>(&pairs), blocks.as_flattened().as_flattened(), "({u}, {v})");
            }
            assert_eq!(in_lanes, in_pairs, "line {v}");
        }
    }

    #[test]
    fn lanes_fuse_as_vectors_do() {
        let mut number = numbers(2);
        for trial in 0..200 {
            // Now and then sums that saturate.
            let most = if trial % 4 == 0 { u16::MAX } else { 30_000 };
            let blocks = [(); 3].map(|()| [(); VIEWS].map(|()| [(); 8].map(|()| number() as u16 % most)));
            let masks =
                [(); 3].map(|()| [(); VIEWS].map(|()| [(); 8].map(|()| if number().is_multiple_of(3) { u16::MAX } else { 0 })));
            for rule in [Rule::Min, Rule::Sum, Rule::Heuristic] {
                let (mut found, mut expected) = ([[0; 8]; 3], [[0; 8]; 3]);
                let least = fuse_lanes::<_, 8, VIEWS, false>(rule, &blocks, &[], &mut found);
                assert_eq!(least, fuse_loop(Portable::<8>, rule, &blocks, &mut expected));
                assert_eq!(found, expected, "{rule:?}");
                let least = fuse_lanes::<_, 8, VIEWS, true>(rule, &blocks, &masks, &mut found);
                assert_eq!(least, fuse_masked_loop(Portable::<8>, rule, &blocks, &masks, &mut expected));
                assert_eq!(found, expected, "{rule:?}, masked");
            }
        }
    }
}
