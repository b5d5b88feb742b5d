//! The operations in plain Rust, over arrays.

use core::array;

use super::{Block, Blocks, Column, Isa};

/// No instruction set in particular: arrays of `N` lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable<const N: usize>;

impl<const N: usize> Isa for Portable<N> {
    const LANES: usize = N;
    type Column = [u16; N];

    #[inline(always)]
    fn load_column(self, sums: &[u16]) -> [u16; N] {
        first(sums)
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8]) -> [u16; N] {
        first(view).map(|sample: u8| center.abs_diff(sample).into())
    }
}

impl<const N: usize> Column for [u16; N] {
    #[inline(always)]
    fn store(self, sums: &mut [u16]) {
        put(self, sums);
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
            type Block = [$lane; N];

            #[inline(always)]
            fn load_block(self, costs: &[$lane]) -> [$lane; N] {
                first(costs)
            }

            #[inline(always)]
            fn splat(self, cost: $lane) -> [$lane; N] {
                [cost; N]
            }
        }

        impl<const N: usize> Block<$lane> for [$lane; N] {
            type Column = [u16; N];

            #[inline(always)]
            fn store(self, costs: &mut [$lane]) {
                put(self, costs);
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

fn first<T: Copy + Default, const N: usize>(slice: &[T]) -> [T; N] {
    slice.first_chunk().copied().unwrap_or([T::default(); N])
}

fn put<T, const N: usize>(vector: [T; N], slice: &mut [T]) {
    if let Some(lanes) = slice.first_chunk_mut() {
        *lanes = vector;
    }
}
