//! AVX2.
//!
//! Unsafe code is sound here by the token: only [`Avx2::new`], which is unsafe, makes one, and only a token makes a vector. Where
//! either is, the processor has AVX2. Loads and stores need no alignment.
#![allow(unsafe_code)]

use core::arch::x86_64::*;

use crate::kernel::{
    blocks::Blocks,
    isa::{Block, Change, Column, Isa, MAX_BATCH, Work, sealed::Sealed},
};

token! {
    /// AVX2: 32 lanes.
    Avx2: "avx2", "bmi1", "lzcnt", "popcnt"
}

/// 32 lanes of 16 bits, in the order in which unpacking bytes leaves them: the lower eight of every sixteen
/// disparities in the first register, the upper eight in the second.
#[derive(Clone, Copy, Debug)]
pub struct U16x32([__m256i; 2]);

/// 32 lanes of 32 bits in the same order.
#[derive(Clone, Copy, Debug)]
pub struct U32x32([__m256i; 4]);

impl Isa for Avx2 {
    const LANES: usize = 32;
    const BATCH: usize = MAX_BATCH;
    type Samples = [u8; 32];
    type Sums = [u16; 32];
    type Column = U16x32;

    #[inline(always)]
    fn lane(index: usize) -> usize {
        LANE[index % 32].into()
    }

    fn compiled<W: Work>(self, work: W) {
        self.run(work);
    }

    #[inline(always)]
    fn load_column(self, sums: &[u16; 32]) -> U16x32 {
        // SAFETY: the token vouches for AVX2. Each load reads a register's worth of the array.
        unsafe { U16x32([_mm256_loadu_si256(sums.as_ptr().cast()), _mm256_loadu_si256(sums[16..].as_ptr().cast())]) }
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 32]) -> U16x32 {
        // SAFETY: the token vouches for AVX2.
        unsafe {
            let (differences, zero) = (absolute_differences(center, view), _mm256_setzero_si256());
            U16x32([_mm256_unpacklo_epi8(differences, zero), _mm256_unpackhi_epi8(differences, zero)])
        }
    }

    #[inline(always)]
    fn advance(self, sums: U16x32, center: Change<u8>, view: Change<&[u8; 32]>) -> U16x32 {
        // SAFETY: the token vouches for AVX2.
        unsafe {
            let entering = absolute_differences(center.entering, view.entering);
            let leaving = absolute_differences(center.leaving, view.leaving);
            // Pairs of bytes, times 1 and -1.
            let signs = _mm256_set1_epi16(i16::from_le_bytes([1, 0xff]));
            let low = _mm256_maddubs_epi16(_mm256_unpacklo_epi8(entering, leaving), signs);
            let high = _mm256_maddubs_epi16(_mm256_unpackhi_epi8(entering, leaving), signs);
            U16x32([_mm256_add_epi16(sums.0[0], low), _mm256_add_epi16(sums.0[1], high)])
        }
    }
}

/// The lane of each disparity.
static LANE: [u8; 32] = {
    let mut lanes = [0; 32];
    let mut index = 0;
    while index < 32 {
        lanes[index] = (index % 8 + index / 16 * 8 + index / 8 % 2 * 16) as u8;
        index += 1;
    }
    lanes
};

/// The absolute differences of the centre's sample and those of a view.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn absolute_differences(center: u8, view: &[u8; 32]) -> __m256i {
    // SAFETY: the caller vouches for AVX2. The load reads an array as long as a register.
    unsafe {
        let (center, view) = (_mm256_set1_epi8(center as i8), _mm256_loadu_si256(view.as_ptr().cast()));
        _mm256_sub_epi8(_mm256_max_epu8(center, view), _mm256_min_epu8(center, view))
    }
}

impl Column for U16x32 {
    type Sums = [u16; 32];

    #[inline(always)]
    fn store(self, sums: &mut [u16; 32]) {
        // SAFETY: a token made the vector, so the processor has AVX2. Each store fills a register's worth of the array.
        unsafe {
            _mm256_storeu_si256(sums.as_mut_ptr().cast(), self.0[0]);
            _mm256_storeu_si256(sums[16..].as_mut_ptr().cast(), self.0[1]);
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_add_epi16(a, b) })
    }
}

impl Blocks<u16> for Avx2 {
    const IN_REGISTERS: bool = true;
    type Costs = [u16; 32];
    type Block = U16x32;

    #[inline(always)]
    fn load_block(self, costs: &[u16; 32]) -> U16x32 {
        self.load_column(costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x32 {
        // SAFETY: the token vouches for AVX2.
        U16x32([unsafe { _mm256_set1_epi16(cost as i16) }; 2])
    }

    #[inline(always)]
    fn position(self, costs: &[[u16; 32]], cost: u16) -> usize {
        // SAFETY: the token vouches for AVX2.
        let cost = unsafe { _mm256_set1_epi16(cost as i16) };
        position(costs, |costs| {
            let U16x32([low, high]) = self.load_column(costs);
            // SAFETY: the token vouches for AVX2.
            unsafe { mask(_mm256_cmpeq_epi16(low, cost), _mm256_cmpeq_epi16(high, cost)) }
        })
    }
}

/// The first disparity whose bit is set in the masks of the vectors, found without a branch.
#[inline(always)]
fn position<T>(costs: &[T], mask: impl Fn(&T) -> u32) -> usize {
    let mut first = 32 * costs.len();
    for (j, costs) in costs.iter().enumerate().rev() {
        let mask = mask(costs);
        first = if mask != 0 { 32 * j + mask.trailing_zeros() as usize } else { first };
    }
    first
}

/// A bit for each lane, set if the lane is all ones. Packing works within halves, so the middle quarters have
/// to be swapped.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn mask(a: __m256i, b: __m256i) -> u32 {
    // SAFETY: the caller vouches for AVX2.
    unsafe { _mm256_movemask_epi8(_mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(a, b))) as u32 }
}

impl Block<u16> for U16x32 {
    type Costs = [u16; 32];
    type Column = U16x32;

    #[inline(always)]
    fn store(self, costs: &mut [u16; 32]) {
        Column::store(self, costs);
    }

    #[inline(always)]
    fn slide(self, entering: U16x32, leaving: U16x32) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        Column::add(self, entering).zip(leaving, |a, b| unsafe { _mm256_sub_epi16(a, b) })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_adds_epu16(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_min_epu16(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_max_epu16(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        let choose = |i: usize| unsafe {
            let not_greater = _mm256_cmpeq_epi16(_mm256_max_epu16(self.0[i], other.0[i]), other.0[i]);
            _mm256_blendv_epi8(then.0[i], otherwise.0[i], not_greater)
        };
        U16x32([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            let whole = _mm256_min_epu16(self.0[0], self.0[1]);
            let half = _mm_min_epu16(_mm256_castsi256_si128(whole), _mm256_extracti128_si256::<1>(whole));
            _mm_cvtsi128_si32(_mm_minpos_epu16(half)) as u16
        }
    }

    #[inline(always)]
    fn ordered(self) -> Self {
        let [low, high] = self.0;
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe { U16x32([_mm256_permute2x128_si256::<0x20>(low, high), _mm256_permute2x128_si256::<0x31>(low, high)]) }
    }
}

impl U16x32 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        U16x32([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }

    /// The lanes in 32 bits.
    #[inline(always)]
    fn widen(self) -> U32x32 {
        // SAFETY: a token made the vector, so the processor has AVX2.
        let low = |whole| unsafe { _mm256_cvtepu16_epi32(_mm256_castsi256_si128(whole)) };
        // SAFETY: a token made the vector, so the processor has AVX2.
        let high = |whole| unsafe { _mm256_cvtepu16_epi32(_mm256_extracti128_si256::<1>(whole)) };
        U32x32([low(self.0[0]), high(self.0[0]), low(self.0[1]), high(self.0[1])])
    }
}

impl Blocks<u32> for Avx2 {
    type Costs = [u32; 32];
    type Block = U32x32;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 32]) -> U32x32 {
        // SAFETY: the token vouches for AVX2. The load reads a register's worth of the array.
        let load = |i: usize| unsafe { _mm256_loadu_si256(costs[8 * i..].as_ptr().cast()) };
        U32x32([load(0), load(1), load(2), load(3)])
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x32 {
        // SAFETY: the token vouches for AVX2.
        U32x32([unsafe { _mm256_set1_epi32(cost as i32) }; 4])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 32]], cost: u32) -> usize {
        // SAFETY: the token vouches for AVX2.
        let cost = unsafe { _mm256_set1_epi32(cost as i32) };
        position(costs, |costs| {
            let U32x32(costs) = Blocks::<u32>::load_block(self, costs);
            // SAFETY: the token vouches for AVX2.
            let equal = |i: usize| unsafe { _mm256_cmpeq_epi32(costs[i], cost) };
            // SAFETY: the token vouches for AVX2.
            let pack = |a, b| unsafe { _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi32(a, b)) };
            // SAFETY: the token vouches for AVX2.
            unsafe { mask(pack(equal(0), equal(1)), pack(equal(2), equal(3))) }
        })
    }
}

impl Block<u32> for U32x32 {
    type Costs = [u32; 32];
    type Column = U16x32;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 32]) {
        for i in 0..4 {
            // SAFETY: a token made the vector, so the processor has AVX2. The store fills a register's worth of the array.
            unsafe { _mm256_storeu_si256(costs[8 * i..].as_mut_ptr().cast(), self.0[i]) }
        }
    }

    #[inline(always)]
    fn slide(self, entering: U16x32, leaving: U16x32) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.add(entering.widen()).zip(leaving.widen(), |a, b| unsafe { _mm256_sub_epi32(a, b) })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_add_epi32(a, b) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_min_epu32(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        self.zip(other, |a, b| unsafe { _mm256_max_epu32(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        let choose = |i: usize| unsafe {
            let not_greater = _mm256_cmpeq_epi32(_mm256_max_epu32(self.0[i], other.0[i]), other.0[i]);
            _mm256_blendv_epi8(then.0[i], otherwise.0[i], not_greater)
        };
        U32x32([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        let [a, b, c, d] = self.0;
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            let whole = _mm256_min_epu32(_mm256_min_epu32(a, b), _mm256_min_epu32(c, d));
            let half = _mm_min_epu32(_mm256_castsi256_si128(whole), _mm256_extracti128_si256::<1>(whole));
            let quarter = _mm_min_epu32(half, _mm_shuffle_epi32::<0b01_00_11_10>(half));
            _mm_cvtsi128_si32(_mm_min_epu32(quarter, _mm_shuffle_epi32::<0b10_11_00_01>(quarter))) as u32
        }
    }

    #[inline(always)]
    fn ordered(self) -> Self {
        let [a, b, c, d] = self.0;
        U32x32([a, c, b, d])
    }
}

impl U32x32 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        U32x32([f(a, e), f(b, g), f(c, h), f(d, i)])
    }
}
