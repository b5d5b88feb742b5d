//! The portable vectors: arrays, which the compiler vectorises.

use multiscopic_core::kernel::Portable;

use super::definition::{LANES, Vector, Vectors};

/// The definition that all other vectors follow.
impl<const N: usize, const B: usize> Vectors for Portable<N, B> {
    type Vector = [u16; LANES];

    #[inline(always)]
    fn splat(self, value: u16) -> [u16; LANES] {
        [value; LANES]
    }

    #[inline(always)]
    fn load(self, values: &[u16; LANES]) -> [u16; LANES] {
        *values
    }

    #[inline(always)]
    fn hamming_distances<const BYTES: usize>(self, descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> [u16; LANES] {
        let mut distances = [0; LANES];
        for (byte, others) in descriptor.iter().zip(descriptors) {
            for (distance, other) in distances.iter_mut().zip(others) {
                *distance += (byte ^ other).count_ones() as u16;
            }
        }
        distances
    }
}

impl Vector for [u16; LANES] {
    #[inline(always)]
    fn store(self, values: &mut [u16; LANES]) {
        *values = self;
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].min(other[i]))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].max(other[i]))
    }

    #[inline(always)]
    fn saturating_add(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].saturating_add(other[i]))
    }

    #[inline(always)]
    fn saturating_sub(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].saturating_sub(other[i]))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        std::array::from_fn(|i| if self[i] > other[i] { then[i] } else { otherwise[i] })
    }

    #[inline(always)]
    fn min_lane(self) -> u16 {
        self.into_iter().fold(u16::MAX, u16::min)
    }

    #[inline(always)]
    fn equal_mask(self, other: Self) -> u32 {
        (0..LANES).fold(0, |bits, i| bits | u32::from(self[i] == other[i]) << i)
    }
}

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
impl Vectors for multiscopic_core::kernel::Neon {
    type Vector = [u16; LANES];

    #[inline(always)]
    fn splat(self, value: u16) -> [u16; LANES] {
        Portable::<8, 1>.splat(value)
    }

    #[inline(always)]
    fn load(self, values: &[u16; LANES]) -> [u16; LANES] {
        Portable::<8, 1>.load(values)
    }

    #[inline(always)]
    fn hamming_distances<const BYTES: usize>(self, descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> [u16; LANES] {
        Portable::<8, 1>.hamming_distances(descriptor, descriptors)
    }
}
