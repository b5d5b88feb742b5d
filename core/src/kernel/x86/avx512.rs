//! AVX-512.
//!
//! Unsafe code is sound here by the token: only [`Avx512::new`], which is unsafe, makes one, and only a token makes a vector.
//! Either proves that the processor has AVX-512. Loads and stores need no alignment.
#![allow(unsafe_code)]

use core::arch::x86_64::*;

use crate::kernel::{
    blocks::Blocks,
    isa::{Block, Change, Column, Isa, MAX_BATCH, Work, sealed::Sealed},
};

token! {
    /// AVX-512 with its extensions BW, DQ and VL: 64 lanes.
    Avx512: "avx512f", "avx512bw", "avx512vl", "avx512dq", "bmi1", "bmi2", "lzcnt", "popcnt"
}

/// 64 lanes of 16 bits, in the order in which unpacking bytes leaves them: the lower eight of every sixteen
/// disparities in the first register, the upper eight in the second.
#[derive(Clone, Copy, Debug)]
pub struct U16x64([__m512i; 2]);

/// 64 lanes of 32 bits in the same order.
#[derive(Clone, Copy, Debug)]
pub struct U32x64([__m512i; 4]);

impl Isa for Avx512 {
    const LANES: usize = 64;
    const BATCH: usize = MAX_BATCH;
    type Samples = [u8; 64];
    type Sums = [u16; 64];
    type Column = U16x64;

    #[inline(always)]
    fn lane(index: usize) -> usize {
        LANE[index % 64].into()
    }

    fn compiled<W: Work>(self, work: W) {
        self.run(work);
    }

    #[inline(always)]
    fn load_column(self, sums: &[u16; 64]) -> U16x64 {
        // SAFETY: the token vouches for AVX-512. Each load reads a register's worth of the array.
        unsafe { U16x64([_mm512_loadu_si512(sums.as_ptr().cast()), _mm512_loadu_si512(sums[32..].as_ptr().cast())]) }
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 64]) -> U16x64 {
        // SAFETY: the token vouches for AVX-512.
        unsafe {
            let (differences, zero) = (absolute_differences(center, view), _mm512_setzero_si512());
            U16x64([_mm512_unpacklo_epi8(differences, zero), _mm512_unpackhi_epi8(differences, zero)])
        }
    }

    #[inline(always)]
    fn advance(self, sums: U16x64, center: Change<u8>, view: Change<&[u8; 64]>) -> U16x64 {
        // SAFETY: the token vouches for AVX-512.
        unsafe {
            let entering = absolute_differences(center.entering, view.entering);
            let leaving = absolute_differences(center.leaving, view.leaving);
            // Pairs of bytes, times 1 and -1.
            let signs = _mm512_set1_epi16(i16::from_le_bytes([1, 0xff]));
            let low = _mm512_maddubs_epi16(_mm512_unpacklo_epi8(entering, leaving), signs);
            let high = _mm512_maddubs_epi16(_mm512_unpackhi_epi8(entering, leaving), signs);
            U16x64([_mm512_add_epi16(sums.0[0], low), _mm512_add_epi16(sums.0[1], high)])
        }
    }
}

/// The lane of each disparity.
static LANE: [u8; 64] = {
    let mut lanes = [0; 64];
    let mut index = 0;
    while index < 64 {
        lanes[index] = (index % 8 + index / 16 * 8 + index / 8 % 2 * 32) as u8;
        index += 1;
    }
    lanes
};

/// The absolute differences of the centre's sample and those of a view.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn absolute_differences(center: u8, view: &[u8; 64]) -> __m512i {
    // SAFETY: the caller vouches for AVX-512. The load reads an array as long as a register.
    unsafe {
        let (center, view) = (_mm512_set1_epi8(center as i8), _mm512_loadu_si512(view.as_ptr().cast()));
        _mm512_sub_epi8(_mm512_max_epu8(center, view), _mm512_min_epu8(center, view))
    }
}

impl Column for U16x64 {
    type Sums = [u16; 64];

    #[inline(always)]
    fn store(self, sums: &mut [u16; 64]) {
        // SAFETY: a token made the vector, so the processor has AVX-512. Each store fills a register's worth of the array.
        unsafe {
            _mm512_storeu_si512(sums.as_mut_ptr().cast(), self.0[0]);
            _mm512_storeu_si512(sums[32..].as_mut_ptr().cast(), self.0[1]);
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_add_epi16(a, b) })
    }
}

impl Blocks<u16> for Avx512 {
    const IN_REGISTERS: bool = true;
    type Costs = [u16; 64];
    type Block = U16x64;

    #[inline(always)]
    fn load_block(self, costs: &[u16; 64]) -> U16x64 {
        self.load_column(costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x64 {
        // SAFETY: the token vouches for AVX-512.
        U16x64([unsafe { _mm512_set1_epi16(cost as i16) }; 2])
    }

    #[inline(always)]
    fn position(self, costs: &[[u16; 64]], cost: u16) -> usize {
        // SAFETY: the token vouches for AVX-512.
        let cost = unsafe { _mm512_set1_epi16(cost as i16) };
        position(costs, |costs| {
            let U16x64(costs) = self.load_column(costs);
            // SAFETY: the token vouches for AVX-512.
            let mask = |i: usize| u64::from(unsafe { _mm512_cmpeq_epu16_mask(costs[i], cost) });
            mask(0) | mask(1) << 32
        })
    }
}

/// The first disparity whose bit is set in the masks of the vectors, found without a branch.
#[inline(always)]
fn position<T>(costs: &[T], mask: impl Fn(&T) -> u64) -> usize {
    let mut first = 64 * costs.len();
    for (j, costs) in costs.iter().enumerate().rev() {
        let mask = mask(costs);
        first = if mask != 0 { 64 * j + mask.trailing_zeros() as usize } else { first };
    }
    first
}

impl Block<u16> for U16x64 {
    type Costs = [u16; 64];
    type Column = U16x64;

    #[inline(always)]
    fn store(self, costs: &mut [u16; 64]) {
        Column::store(self, costs);
    }

    #[inline(always)]
    fn slide(self, entering: U16x64, leaving: U16x64) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        Column::add(self, entering).zip(leaving, |a, b| unsafe { _mm512_sub_epi16(a, b) })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_adds_epu16(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_min_epu16(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_max_epu16(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let choose = |i: usize| unsafe {
            _mm512_mask_blend_epi16(_mm512_cmpgt_epu16_mask(self.0[i], other.0[i]), otherwise.0[i], then.0[i])
        };
        U16x64([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe {
            let whole = _mm512_min_epu16(self.0[0], self.0[1]);
            let half = _mm256_min_epu16(_mm512_castsi512_si256(whole), _mm512_extracti64x4_epi64::<1>(whole));
            let quarter = _mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half));
            _mm_cvtsi128_si32(_mm_minpos_epu16(quarter)) as u16
        }
    }

    #[inline(always)]
    fn ordered(self) -> Self {
        let [low, high] = self.0;
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let order = |quarters| unsafe { _mm512_permutex2var_epi64(low, quarters, high) };
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe {
            U16x64([order(_mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11)), order(_mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15))])
        }
    }
}

impl U16x64 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m512i, __m512i) -> __m512i) -> Self {
        U16x64([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }

    /// The lanes in 32 bits.
    #[inline(always)]
    fn widen(self) -> U32x64 {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let low = |whole| unsafe { _mm512_cvtepu16_epi32(_mm512_castsi512_si256(whole)) };
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let high = |whole| unsafe { _mm512_cvtepu16_epi32(_mm512_extracti64x4_epi64::<1>(whole)) };
        U32x64([low(self.0[0]), high(self.0[0]), low(self.0[1]), high(self.0[1])])
    }
}

impl Blocks<u32> for Avx512 {
    type Costs = [u32; 64];
    type Block = U32x64;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 64]) -> U32x64 {
        // SAFETY: the token vouches for AVX-512. The load reads a register's worth of the array.
        let load = |i: usize| unsafe { _mm512_loadu_si512(costs[16 * i..].as_ptr().cast()) };
        U32x64([load(0), load(1), load(2), load(3)])
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x64 {
        // SAFETY: the token vouches for AVX-512.
        U32x64([unsafe { _mm512_set1_epi32(cost as i32) }; 4])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 64]], cost: u32) -> usize {
        // SAFETY: the token vouches for AVX-512.
        let cost = unsafe { _mm512_set1_epi32(cost as i32) };
        position(costs, |costs| {
            let U32x64(costs) = Blocks::<u32>::load_block(self, costs);
            // SAFETY: the token vouches for AVX-512.
            let mask = |i: usize| u64::from(unsafe { _mm512_cmpeq_epu32_mask(costs[i], cost) });
            mask(0) | mask(1) << 16 | mask(2) << 32 | mask(3) << 48
        })
    }
}

impl Block<u32> for U32x64 {
    type Costs = [u32; 64];
    type Column = U16x64;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 64]) {
        for i in 0..4 {
            // SAFETY: a token made the vector, so the processor has AVX-512. The store fills a register's worth of the array.
            unsafe { _mm512_storeu_si512(costs[16 * i..].as_mut_ptr().cast(), self.0[i]) }
        }
    }

    #[inline(always)]
    fn slide(self, entering: U16x64, leaving: U16x64) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.add(entering.widen()).zip(leaving.widen(), |a, b| unsafe { _mm512_sub_epi32(a, b) })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_add_epi32(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_min_epu32(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        self.zip(other, |a, b| unsafe { _mm512_max_epu32(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let choose = |i: usize| unsafe {
            _mm512_mask_blend_epi32(_mm512_cmpgt_epu32_mask(self.0[i], other.0[i]), otherwise.0[i], then.0[i])
        };
        U32x64([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        let [a, b, c, d] = self.0;
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe { _mm512_reduce_min_epu32(_mm512_min_epu32(_mm512_min_epu32(a, b), _mm512_min_epu32(c, d))) }
    }

    #[inline(always)]
    fn ordered(self) -> Self {
        let [a, b, c, d] = self.0;
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let first = |a, b| unsafe { _mm512_shuffle_i64x2::<0b01_00_01_00>(a, b) };
        // SAFETY: a token made the vector, so the processor has AVX-512.
        let second = |a, b| unsafe { _mm512_shuffle_i64x2::<0b11_10_11_10>(a, b) };
        U32x64([first(a, c), second(a, c), first(b, d), second(b, d)])
    }
}

impl U32x64 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m512i, __m512i) -> __m512i) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        U32x64([f(a, e), f(b, g), f(c, h), f(d, i)])
    }
}
