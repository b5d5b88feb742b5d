//! NEON: the vector instructions of 64-bit Arm.
//!
//! The module is only compiled where every processor of the target has NEON.
#![allow(unsafe_code)]

use core::{arch::aarch64::*, array};

use crate::kernel::{
    blocks::Blocks,
    bytes::{ByteVector, Bytes, PixelLoops, RunLoops},
    isa::{Block, Change, Column, Isa, MAX_BATCH, sealed::Sealed},
};

/// NEON: 16 lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Neon;

/// 16 lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x16([uint16x8_t; 2]);

/// 16 lanes of 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct U32x16([uint32x4_t; 4]);

impl Sealed for Neon {}

impl Isa for Neon {
    const LANES: usize = 16;
    const BATCH: usize = MAX_BATCH;
    type Samples = [u8; 16];
    type Sums = [u16; 16];
    type Column = U16x16;

    #[inline(always)]
    fn load_column(self, sums: &[u16; 16]) -> U16x16 {
        // SAFETY: every processor of the target has NEON. Each load reads a register's worth of the array.
        unsafe { U16x16([vld1q_u16(sums.as_ptr()), vld1q_u16(sums[8..].as_ptr())]) }
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 16]) -> U16x16 {
        // SAFETY: every processor of the target has NEON. The load reads an array as long as a register.
        unsafe {
            let (center, view) = (vdupq_n_u8(center), vld1q_u8(view.as_ptr()));
            U16x16([vabdl_u8(vget_low_u8(center), vget_low_u8(view)), vabdl_high_u8(center, view)])
        }
    }

    #[inline(always)]
    fn advance(self, sums: U16x16, center: Change<u8>, view: Change<&[u8; 16]>) -> U16x16 {
        // SAFETY: every processor of the target has NEON. Each load reads a register's worth of the array.
        unsafe {
            // One instruction takes absolute differences, widens and adds them. There is none that subtracts
            // them.
            let (center_entering, entering) = (vdupq_n_u8(center.entering), vld1q_u8(view.entering.as_ptr()));
            let low = vabal_u8(sums.0[0], vget_low_u8(center_entering), vget_low_u8(entering));
            let high = vabal_high_u8(sums.0[1], center_entering, entering);
            let leaving = vabdq_u8(vdupq_n_u8(center.leaving), vld1q_u8(view.leaving.as_ptr()));
            U16x16([vsubw_u8(low, vget_low_u8(leaving)), vsubw_high_u8(high, leaving)])
        }
    }
}

impl Column for U16x16 {
    type Sums = [u16; 16];

    #[inline(always)]
    fn store(self, sums: &mut [u16; 16]) {
        // SAFETY: every processor of the target has NEON. Each store fills a register's worth of the array.
        unsafe {
            vst1q_u16(sums.as_mut_ptr(), self.0[0]);
            vst1q_u16(sums[8..].as_mut_ptr(), self.0[1]);
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vaddq_u16(a, b) })
    }
}

impl Blocks<u16> for Neon {
    const IN_REGISTERS: bool = true;
    type Costs = [u16; 16];
    type Block = U16x16;

    #[inline(always)]
    fn load_block(self, costs: &[u16; 16]) -> U16x16 {
        self.load_column(costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x16 {
        // SAFETY: every processor of the target has NEON.
        U16x16([unsafe { vdupq_n_u16(cost) }; 2])
    }

    /// The least of the indices whose lanes are equal, found without a branch.
    #[inline(always)]
    fn position(self, costs: &[[u16; 16]], cost: u16) -> usize {
        // SAFETY: every processor of the target has NEON. The load reads an array as long as a register.
        unsafe {
            let cost = vdupq_n_u16(cost);
            let mut indices = vld1q_u16([0, 1, 2, 3, 4, 5, 6, 7].as_ptr());
            let mut first = vdupq_n_u16(u16::MAX);
            for costs in costs {
                for costs in self.load_column(costs).0 {
                    first = vminq_u16(first, vornq_u16(indices, vceqq_u16(costs, cost)));
                    indices = vaddq_u16(indices, vdupq_n_u16(8));
                }
            }
            vminvq_u16(first).into()
        }
    }
}

impl Block<u16> for U16x16 {
    type Costs = [u16; 16];
    type Column = U16x16;

    #[inline(always)]
    fn store(self, costs: &mut [u16; 16]) {
        Column::store(self, costs);
    }

    #[inline(always)]
    fn slide(self, entering: U16x16, leaving: U16x16) -> Self {
        // SAFETY: every processor of the target has NEON.
        Column::add(self, entering).zip(leaving, |a, b| unsafe { vsubq_u16(a, b) })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vqaddq_u16(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vminq_u16(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vmaxq_u16(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        let choose = |i: usize| unsafe { vbslq_u16(vcgtq_u16(self.0[i], other.0[i]), then.0[i], otherwise.0[i]) };
        U16x16([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        // SAFETY: every processor of the target has NEON.
        unsafe { vminvq_u16(vminq_u16(self.0[0], self.0[1])) }
    }
}

impl U16x16 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(uint16x8_t, uint16x8_t) -> uint16x8_t) -> Self {
        U16x16([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

impl Blocks<u32> for Neon {
    const IN_REGISTERS: bool = true;
    type Costs = [u32; 16];
    type Block = U32x16;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 16]) -> U32x16 {
        // SAFETY: every processor of the target has NEON. The load reads a register's worth of the array.
        U32x16(array::from_fn(|i| unsafe { vld1q_u32(costs[4 * i..4 * i + 4].as_ptr()) }))
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x16 {
        // SAFETY: every processor of the target has NEON.
        U32x16([unsafe { vdupq_n_u32(cost) }; 4])
    }

    /// The least of the indices whose lanes are equal, found without a branch.
    #[inline(always)]
    fn position(self, costs: &[[u32; 16]], cost: u32) -> usize {
        // SAFETY: every processor of the target has NEON. The load reads an array as long as a register.
        unsafe {
            let cost = vdupq_n_u32(cost);
            let mut indices = vld1q_u32([0, 1, 2, 3].as_ptr());
            let mut first = vdupq_n_u32(u32::MAX);
            for costs in costs {
                let U32x16(costs) = Blocks::<u32>::load_block(self, costs);
                for costs in costs {
                    first = vminq_u32(first, vornq_u32(indices, vceqq_u32(costs, cost)));
                    indices = vaddq_u32(indices, vdupq_n_u32(4));
                }
            }
            vminvq_u32(first) as usize
        }
    }
}

impl Block<u32> for U32x16 {
    type Costs = [u32; 16];
    type Column = U16x16;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 16]) {
        for (costs, lanes) in costs.as_chunks_mut::<4>().0.iter_mut().zip(self.0) {
            // SAFETY: every processor of the target has NEON. The store fills an array as long as a register.
            unsafe { vst1q_u32(costs.as_mut_ptr(), lanes) };
        }
    }

    #[inline(always)]
    fn slide(self, entering: U16x16, leaving: U16x16) -> Self {
        // SAFETY: every processor of the target has NEON.
        let low =
            |lanes, i: usize| unsafe { vsubw_u16(vaddw_u16(lanes, vget_low_u16(entering.0[i])), vget_low_u16(leaving.0[i])) };
        // SAFETY: every processor of the target has NEON.
        let high = |lanes, i: usize| unsafe { vsubw_high_u16(vaddw_high_u16(lanes, entering.0[i]), leaving.0[i]) };
        let [a, b, c, d] = self.0;
        U32x16([low(a, 0), high(b, 0), low(c, 1), high(d, 1)])
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vaddq_u32(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vminq_u32(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        self.zip(other, |a, b| unsafe { vmaxq_u32(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        let choose = |i: usize| unsafe { vbslq_u32(vcgtq_u32(self.0[i], other.0[i]), then.0[i], otherwise.0[i]) };
        U32x16([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        let [a, b, c, d] = self.0;
        // SAFETY: every processor of the target has NEON.
        unsafe { vminvq_u32(vminq_u32(vminq_u32(a, b), vminq_u32(c, d))) }
    }
}

impl U32x16 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(uint32x4_t, uint32x4_t) -> uint32x4_t) -> Self {
        U32x16(array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

/// 16 lanes of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct U8x16(uint8x16_t);

impl Bytes for Neon {
    type Bytes = U8x16;

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 16]) -> U8x16 {
        // SAFETY: every processor of the target has NEON. The load reads an array as long as a register.
        U8x16(unsafe { vld1q_u8(costs.as_ptr()) })
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> U8x16 {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vdupq_n_u8(cost) })
    }

    #[inline(always)]
    fn byte_indices(self) -> U8x16 {
        self.load_bytes(&core::array::from_fn(|i| i as u8))
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 16]; N]) -> U8x16 {
        // SAFETY: every processor of the target has NEON. The load reads an array as long as a register.
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
        // SAFETY: every processor of the target has NEON. The store fills an array as long as a register.
        unsafe { vst1q_u8(costs.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vqaddq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vqsubq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vminq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vmaxq_u8(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vbslq_u8(vcgtq_u8(self.0, other.0), then.0, otherwise.0) })
    }

    #[inline(always)]
    fn halved(self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vshrq_n_u8::<1>(self.0) })
    }

    #[inline(always)]
    fn third(self) -> Self {
        // SAFETY: every processor of the target has NEON.
        unsafe {
            // 43 / 128 is exact up to 127.
            let factor = vdup_n_u8(43);
            let low = vshrn_n_u16::<7>(vmull_u8(vget_low_u8(self.0), factor));
            U8x16(vcombine_u8(low, vshrn_n_u16::<7>(vmull_u8(vget_high_u8(self.0), factor))))
        }
    }

    #[inline(always)]
    fn least(self) -> u8 {
        // SAFETY: every processor of the target has NEON.
        unsafe { vminvq_u8(self.0) }
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vdupq_n_u8(vminvq_u8(self.0)) })
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vextq_u8::<15>(previous.0, self.0) })
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        // SAFETY: every processor of the target has NEON.
        U8x16(unsafe { vextq_u8::<1>(self.0, next.0) })
    }
}
