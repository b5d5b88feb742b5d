//! Plain Rust over arrays: the definition of every operation.

use super::{
    blocks::Blocks,
    bytes::{ByteVector, Bytes, PixelLoops, RunLoops},
    isa::{Block, Change, Column, Isa, sealed::Sealed},
};

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
    use super::*;

    #[test]
    fn bytes_move_between_vectors() {
        assert_eq!([1, 2, 3, 4].moved_up([5, 6, 7, 8]), [8, 1, 2, 3]);
        assert_eq!([1, 2, 3, 4].moved_down([5, 6, 7, 8]), [2, 3, 4, 5]);
        assert_eq!([4, 2, 3, 9].least_in_each(), [2; 4]);
    }
}
