//! The operations in plain Rust, over arrays.

use core::array;

use super::{Block, Blocks, Column, Isa};

/// No instruction set in particular: arrays of `N` lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable<const N: usize>;

impl<const N: usize> Isa for Portable<N> {
    const LANES: usize = N;
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

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        array::from_fn(|i| self[i].wrapping_sub(other[i]))
    }
}

macro_rules! blocks {
    ($lane:ty, $add:ident) => {
        impl<const N: usize> Blocks<$lane> for Portable<N> {
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
                array::from_fn(|i| self[i].wrapping_add(entering[i].into()).wrapping_sub(leaving[i].into()))
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

            #[inline(always)]
            fn position(self, cost: $lane) -> Option<usize> {
                self.iter().position(|&lane| lane == cost)
            }
        }
    };
}

blocks!(u16, saturating_add);
blocks!(u32, wrapping_add);
