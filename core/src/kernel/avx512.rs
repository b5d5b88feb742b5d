//! The operations in AVX-512.
//!
//! A vector is only made by a token, and a token only by who vouches for the processor: so the instructions exist. Memory is only
//! reached through arrays as large as the vector.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::x86_64::*;

use super::{Block, Blocks, Column, Isa};

/// AVX-512 with its extensions BW, DQ and VL: 32 lanes.
#[derive(Clone, Copy, Debug)]
pub struct Avx512(());

/// Thirty-two lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x32(__m512i);

/// Thirty-two lanes of 32 bits: the lower half and the upper.
#[derive(Clone, Copy, Debug)]
pub struct U32x32([__m512i; 2]);

impl Avx512 {
    /// The token. What uses it should be compiled for AVX-512 too, or every operation is a call.
    ///
    /// # Safety
    /// The processor has AVX-512F, BW, DQ and VL.
    pub const unsafe fn new() -> Avx512 {
        Avx512(())
    }
}

impl Isa for Avx512 {
    const LANES: usize = 32;
    type Column = U16x32;

    #[inline(always)]
    fn load_column(self, sums: &[u16]) -> U16x32 {
        U16x32(sums.first_chunk::<32>().map_or_else(zero, |sums| unsafe { _mm512_loadu_si512(sums.as_ptr().cast()) }))
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8]) -> U16x32 {
        let Some(view) = view.first_chunk::<32>() else { return U16x32(zero()) };
        unsafe {
            let view = _mm512_cvtepu8_epi16(_mm256_loadu_si256(view.as_ptr().cast()));
            U16x32(_mm512_abs_epi16(_mm512_sub_epi16(view, _mm512_set1_epi16(center.into()))))
        }
    }
}

impl Column for U16x32 {
    #[inline(always)]
    fn store(self, sums: &mut [u16]) {
        if let Some(sums) = sums.first_chunk_mut::<32>() {
            unsafe { _mm512_storeu_si512(sums.as_mut_ptr().cast(), self.0) }
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        U16x32(unsafe { _mm512_add_epi16(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        U16x32(unsafe { _mm512_sub_epi16(self.0, other.0) })
    }
}

impl Blocks<u16> for Avx512 {
    type Block = U16x32;

    #[inline(always)]
    fn load_block(self, costs: &[u16]) -> U16x32 {
        self.load_column(costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x32 {
        U16x32(unsafe { _mm512_set1_epi16(cost as i16) })
    }
}

impl Block<u16> for U16x32 {
    type Column = U16x32;

    #[inline(always)]
    fn store(self, costs: &mut [u16]) {
        Column::store(self, costs);
    }

    #[inline(always)]
    fn slide(self, entering: U16x32, leaving: U16x32) -> Self {
        Column::add(self, entering).sub(leaving)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        U16x32(unsafe { _mm512_adds_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        U16x32(unsafe { _mm512_min_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        U16x32(unsafe { _mm512_max_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        U16x32(unsafe { _mm512_mask_blend_epi16(_mm512_cmpgt_epu16_mask(self.0, other.0), otherwise.0, then.0) })
    }

    #[inline(always)]
    fn least(self) -> u16 {
        unsafe {
            let half = _mm256_min_epu16(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            let quarter = _mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half));
            _mm_cvtsi128_si32(_mm_minpos_epu16(quarter)) as u16
        }
    }

    #[inline(always)]
    fn position(self, cost: u16) -> Option<usize> {
        let equal = unsafe { _mm512_cmpeq_epu16_mask(self.0, _mm512_set1_epi16(cost as i16)) };
        (equal != 0).then_some(equal.trailing_zeros() as usize)
    }
}

impl Blocks<u32> for Avx512 {
    type Block = U32x32;

    #[inline(always)]
    fn load_block(self, costs: &[u32]) -> U32x32 {
        let Some(costs) = costs.first_chunk::<32>() else { return U32x32([zero(); 2]) };
        U32x32([0, 16].map(|lane| unsafe { _mm512_loadu_si512(costs[lane..].as_ptr().cast()) }))
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x32 {
        U32x32([unsafe { _mm512_set1_epi32(cost as i32) }; 2])
    }
}

impl Block<u32> for U32x32 {
    type Column = U16x32;

    #[inline(always)]
    fn store(self, costs: &mut [u32]) {
        if let Some(costs) = costs.first_chunk_mut::<32>() {
            unsafe {
                _mm512_storeu_si512(costs.as_mut_ptr().cast(), self.0[0]);
                _mm512_storeu_si512(costs[16..].as_mut_ptr().cast(), self.0[1]);
            }
        }
    }

    #[inline(always)]
    fn slide(self, entering: U16x32, leaving: U16x32) -> Self {
        let slide = |block, entering, leaving| unsafe {
            _mm512_sub_epi32(_mm512_add_epi32(block, _mm512_cvtepu16_epi32(entering)), _mm512_cvtepu16_epi32(leaving))
        };
        let halves = |sums: U16x32| unsafe { (_mm512_castsi512_si256(sums.0), _mm512_extracti64x4_epi64::<1>(sums.0)) };
        let (entering, leaving) = (halves(entering), halves(leaving));
        U32x32([slide(self.0[0], entering.0, leaving.0), slide(self.0[1], entering.1, leaving.1)])
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm512_add_epi32(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm512_min_epu32(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm512_max_epu32(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |half: usize| unsafe {
            _mm512_mask_blend_epi32(_mm512_cmpgt_epu32_mask(self.0[half], other.0[half]), otherwise.0[half], then.0[half])
        };
        U32x32([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        unsafe { _mm512_reduce_min_epu32(_mm512_min_epu32(self.0[0], self.0[1])) }
    }

    #[inline(always)]
    fn position(self, cost: u32) -> Option<usize> {
        let equal = self.0.map(|costs| u32::from(unsafe { _mm512_cmpeq_epu32_mask(costs, _mm512_set1_epi32(cost as i32)) }));
        let equal = equal[0] | equal[1] << 16;
        (equal != 0).then_some(equal.trailing_zeros() as usize)
    }
}

impl U32x32 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m512i, __m512i) -> __m512i) -> Self {
        U32x32([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

#[inline(always)]
fn zero() -> __m512i {
    unsafe { _mm512_setzero_si512() }
}
