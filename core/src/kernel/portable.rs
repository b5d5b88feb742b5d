//! Plain Rust over arrays: the definition of every operation.

use core::array;

use super::{
    blocks::Blocks,
    isa::{Change, Isa, sealed::Sealed},
    vector::{Block, Column},
};

/// No instruction set in particular: arrays of `N` lanes, and batches of `B` pixels.
///
/// Every other instruction set is compared with the one that has as many lanes and batches as large.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable<const N: usize, const B: usize = 1>;

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
        view.map(|sample| center.abs_diff(sample).into())
    }

    #[inline(always)]
    fn advance(self, sums: [u16; N], center: Change<u8>, view: Change<&[u8; N]>) -> [u16; N] {
        let (entering, leaving) =
            (self.differences(center.entering, view.entering), self.differences(center.leaving, view.leaving));
        array::from_fn(|i| sums[i].wrapping_add(entering[i]).wrapping_sub(leaving[i]))
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
        array::from_fn(|i| self[i].wrapping_add(other[i]))
    }
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
                array::from_fn(|i| self[i].wrapping_add(entering[i].wrapping_sub(leaving[i]) as i16 as $lane))
            }

            #[inline(always)]
            fn add(self, other: Self) -> Self {
                array::from_fn(|i| self[i].$add(other[i]))
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                array::from_fn(|i| self[i].min(other[i]))
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                array::from_fn(|i| self[i].max(other[i]))
            }

            #[inline(always)]
            fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
                array::from_fn(|i| if self[i] > other[i] { then[i] } else { otherwise[i] })
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
