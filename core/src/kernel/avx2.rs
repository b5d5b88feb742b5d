//! The operations in AVX2.
//!
//! A vector is only made by a token, and a token only by who vouches for the processor: so the instructions exist. Memory is only
//! reached through arrays as large as the vector.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::x86_64::*;

use super::{Block, Blocks, Column, Isa};

/// AVX2: 16 lanes.
#[derive(Clone, Copy, Debug)]
pub struct Avx2(());

/// Sixteen lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x16(__m256i);

/// Sixteen lanes of 32 bits: the lower half and the upper.
#[derive(Clone, Copy, Debug)]
pub struct U32x16([__m256i; 2]);

impl Avx2 {
    /// The token. What uses it should be compiled for AVX2 too, or every operation is a call.
    ///
    /// # Safety
    /// The processor has AVX2.
    pub const unsafe fn new() -> Avx2 {
        Avx2(())
    }
}

impl Isa for Avx2 {
    const LANES: usize = 16;
    type Column = U16x16;

    #[inline(always)]
    fn load_column(self, sums: &[u16]) -> U16x16 {
        U16x16(sums.first_chunk::<16>().map_or_else(zero, |sums| unsafe { _mm256_loadu_si256(sums.as_ptr().cast()) }))
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8]) -> U16x16 {
        let Some(view) = view.first_chunk::<16>() else { return U16x16(zero()) };
        unsafe {
            let view = _mm256_cvtepu8_epi16(_mm_loadu_si128(view.as_ptr().cast()));
            U16x16(_mm256_abs_epi16(_mm256_sub_epi16(view, _mm256_set1_epi16(center.into()))))
        }
    }
}

impl Column for U16x16 {
    #[inline(always)]
    fn store(self, sums: &mut [u16]) {
        if let Some(sums) = sums.first_chunk_mut::<16>() {
            unsafe { _mm256_storeu_si256(sums.as_mut_ptr().cast(), self.0) }
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        U16x16(unsafe { _mm256_add_epi16(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        U16x16(unsafe { _mm256_sub_epi16(self.0, other.0) })
    }
}

impl Blocks<u16> for Avx2 {
    type Block = U16x16;

    #[inline(always)]
    fn load_block(self, costs: &[u16]) -> U16x16 {
        self.load_column(costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x16 {
        U16x16(unsafe { _mm256_set1_epi16(cost as i16) })
    }
}

impl Block<u16> for U16x16 {
    type Column = U16x16;

    #[inline(always)]
    fn store(self, costs: &mut [u16]) {
        Column::store(self, costs);
    }

    #[inline(always)]
    fn slide(self, entering: U16x16, leaving: U16x16) -> Self {
        Column::add(self, entering).sub(leaving)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        U16x16(unsafe { _mm256_adds_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        U16x16(unsafe { _mm256_min_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        U16x16(unsafe { _mm256_max_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        U16x16(unsafe {
            let not_greater = _mm256_cmpeq_epi16(_mm256_max_epu16(self.0, other.0), other.0);
            _mm256_blendv_epi8(then.0, otherwise.0, not_greater)
        })
    }

    #[inline(always)]
    fn least(self) -> u16 {
        unsafe {
            let half = _mm_min_epu16(_mm256_castsi256_si128(self.0), _mm256_extracti128_si256::<1>(self.0));
            _mm_cvtsi128_si32(_mm_minpos_epu16(half)) as u16
        }
    }

    #[inline(always)]
    fn position(self, cost: u16) -> Option<usize> {
        let equal = unsafe { _mm256_movemask_epi8(_mm256_cmpeq_epi16(self.0, _mm256_set1_epi16(cost as i16))) };
        (equal != 0).then_some(equal.trailing_zeros() as usize / 2)
    }
}

impl Blocks<u32> for Avx2 {
    type Block = U32x16;

    #[inline(always)]
    fn load_block(self, costs: &[u32]) -> U32x16 {
        let Some(costs) = costs.first_chunk::<16>() else { return U32x16([zero(); 2]) };
        U32x16([0, 8].map(|lane| unsafe { _mm256_loadu_si256(costs[lane..].as_ptr().cast()) }))
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x16 {
        U32x16([unsafe { _mm256_set1_epi32(cost as i32) }; 2])
    }
}

impl Block<u32> for U32x16 {
    type Column = U16x16;

    #[inline(always)]
    fn store(self, costs: &mut [u32]) {
        if let Some(costs) = costs.first_chunk_mut::<16>() {
            unsafe {
                _mm256_storeu_si256(costs.as_mut_ptr().cast(), self.0[0]);
                _mm256_storeu_si256(costs[8..].as_mut_ptr().cast(), self.0[1]);
            }
        }
    }

    #[inline(always)]
    fn slide(self, entering: U16x16, leaving: U16x16) -> Self {
        let slide = |block, entering, leaving| unsafe {
            _mm256_sub_epi32(_mm256_add_epi32(block, _mm256_cvtepu16_epi32(entering)), _mm256_cvtepu16_epi32(leaving))
        };
        let halves = |sums: U16x16| unsafe { (_mm256_castsi256_si128(sums.0), _mm256_extracti128_si256::<1>(sums.0)) };
        let (entering, leaving) = (halves(entering), halves(leaving));
        U32x16([slide(self.0[0], entering.0, leaving.0), slide(self.0[1], entering.1, leaving.1)])
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_add_epi32(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_min_epu32(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_max_epu32(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let not_greater = self.max(other).zip(other, |a, b| unsafe { _mm256_cmpeq_epi32(a, b) });
        let choose = |half: usize| unsafe { _mm256_blendv_epi8(then.0[half], otherwise.0[half], not_greater.0[half]) };
        U32x16([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        let mut lanes = [0; 16];
        self.store(&mut lanes);
        lanes.into_iter().fold(u32::MAX, u32::min)
    }

    #[inline(always)]
    fn position(self, cost: u32) -> Option<usize> {
        let equal = self.0.map(|costs| unsafe {
            _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(costs, _mm256_set1_epi32(cost as i32)))) as u32
        });
        let equal = equal[0] | equal[1] << 8;
        (equal != 0).then_some(equal.trailing_zeros() as usize)
    }
}

impl U32x16 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        U32x16([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

#[inline(always)]
fn zero() -> __m256i {
    unsafe { _mm256_setzero_si256() }
}
