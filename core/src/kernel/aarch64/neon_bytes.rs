//! NEON: costs in 8-bit lanes. The safety contract is that of [`neon`](super::neon).
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::aarch64::*;

use super::Neon;
use crate::kernel::bytes::{ByteVector, Bytes, PixelLoops, RunLoops};

/// 16 lanes of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct U8x16(uint8x16_t);

impl Bytes for Neon {
    type Bytes = U8x16;

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 16]) -> U8x16 {
        U8x16(unsafe { vld1q_u8(costs.as_ptr()) })
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> U8x16 {
        U8x16(unsafe { vdupq_n_u8(cost) })
    }

    #[inline(always)]
    fn byte_indices(self) -> U8x16 {
        self.load_bytes(&core::array::from_fn(|i| i as u8))
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 16]; N]) -> U8x16 {
        unsafe {
            let mut sum = vdupq_n_u8(0);
            for byte in 0..N {
                let bits = veorq_u8(vdupq_n_u8(descriptor[byte]), vld1q_u8(others[byte].as_ptr()));
                sum = vaddq_u8(sum, vcntq_u8(bits));
            }
            U8x16(sum)
        }
    }
}

impl PixelLoops for Neon {}

impl RunLoops for Neon {}

impl ByteVector for U8x16 {
    type Memory = [u8; 16];

    #[inline(always)]
    fn store(self, costs: &mut [u8; 16]) {
        unsafe { vst1q_u8(costs.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        U8x16(unsafe { vqaddq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        U8x16(unsafe { vqsubq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        U8x16(unsafe { vminq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        U8x16(unsafe { vmaxq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        U8x16(unsafe { vbslq_u8(vcgtq_u8(self.0, other.0), then.0, otherwise.0) })
    }

    #[inline(always)]
    fn halved(self) -> Self {
        U8x16(unsafe { vshrq_n_u8::<1>(self.0) })
    }

    #[inline(always)]
    fn third(self) -> Self {
        unsafe {
            // 43 / 128 is exact up to 127.
            let factor = vdup_n_u8(43);
            let low = vshrn_n_u16::<7>(vmull_u8(vget_low_u8(self.0), factor));
            U8x16(vcombine_u8(low, vshrn_n_u16::<7>(vmull_u8(vget_high_u8(self.0), factor))))
        }
    }

    #[inline(always)]
    fn least(self) -> u8 {
        unsafe { vminvq_u8(self.0) }
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        U8x16(unsafe { vdupq_n_u8(vminvq_u8(self.0)) })
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        U8x16(unsafe { vextq_u8::<15>(previous.0, self.0) })
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        U8x16(unsafe { vextq_u8::<1>(self.0, next.0) })
    }
}
