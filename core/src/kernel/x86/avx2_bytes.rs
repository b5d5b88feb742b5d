//! AVX2: costs in 8-bit lanes. Unsafe code is sound as in [`avx2`](super::avx2).
#![allow(unsafe_code)]

use core::arch::x86_64::*;

use super::Avx2;
use crate::kernel::bytes::{ByteVector, Bytes, Divisor, PixelLoops, RunLoops};

/// 32 lanes of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct U8x32(__m256i);

impl U8x32 {
    /// The least of all lanes, in the first.
    ///
    /// # Safety
    /// The processor has AVX2.
    #[inline(always)]
    unsafe fn least_first(self) -> __m128i {
        // SAFETY: the caller vouches for AVX2.
        unsafe {
            let half = _mm_min_epu8(_mm256_castsi256_si128(self.0), _mm256_extracti128_si256::<1>(self.0));
            _mm_minpos_epu16(_mm_min_epu8(half, _mm_srli_epi16::<8>(half)))
        }
    }
}

/// `factors` are 1 and the number of paths, in turns. Those times the excess and the costs, in 16 bits: the sums of
/// the lower and the upper half of each half of the lanes.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn path_sums(costs: U8x32, excess: U8x32, factors: __m256i) -> [__m256i; 2] {
    // SAFETY: the caller vouches for AVX2.
    unsafe {
        let (low, high) = (_mm256_unpacklo_epi8(excess.0, costs.0), _mm256_unpackhi_epi8(excess.0, costs.0));
        [_mm256_maddubs_epi16(low, factors), _mm256_maddubs_epi16(high, factors)]
    }
}

/// Divides sums: [`Divisor::divide`], but for the limit of quotients of three.
///
/// # Safety
/// The processor has AVX2, and `sums` points to as many sums as a register holds.
#[inline(always)]
unsafe fn divide(divisor: Divisor, sums: *const u16) -> __m256i {
    // SAFETY: the caller vouches for AVX2 and for the sums.
    unsafe {
        let sums = _mm256_loadu_si256(sums.cast());
        let shifted = _mm256_srl_epi16(sums, _mm_cvtsi32_si128(divisor.shift as i32));
        if divisor.by_three {
            let limited = _mm256_min_epu16(shifted, _mm256_set1_epi16(Divisor::MOST_THIRDS as i16));
            _mm256_srli_epi16::<9>(_mm256_mullo_epi16(limited, _mm256_set1_epi16(171)))
        } else {
            _mm256_min_epu16(shifted, _mm256_set1_epi16(Divisor::LIMIT.into()))
        }
    }
}

impl Bytes for Avx2 {
    type Bytes = U8x32;

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 32]) -> U8x32 {
        // SAFETY: the token vouches for AVX2. The load reads an array as long as a register.
        U8x32(unsafe { _mm256_loadu_si256(costs.as_ptr().cast()) })
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> U8x32 {
        // SAFETY: the token vouches for AVX2.
        U8x32(unsafe { _mm256_set1_epi8(cost as i8) })
    }

    #[inline(always)]
    fn byte_indices(self) -> U8x32 {
        self.load_bytes(&core::array::from_fn(|i| i as u8))
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 32]; N]) -> U8x32 {
        // SAFETY: the token vouches for AVX2. The load reads an array as long as a register.
        unsafe {
            // The number of set bits of each four-bit number.
            let counts = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
            let low = _mm256_set1_epi8(0xf);
            let mut sum = _mm256_setzero_si256();
            for byte in 0..N {
                let others = _mm256_loadu_si256(others[byte].as_ptr().cast());
                let bits = _mm256_xor_si256(_mm256_set1_epi8(descriptor[byte] as i8), others);
                let lower = _mm256_shuffle_epi8(counts, _mm256_and_si256(bits, low));
                let upper = _mm256_shuffle_epi8(counts, _mm256_and_si256(_mm256_srli_epi16::<4>(bits), low));
                sum = _mm256_add_epi8(sum, _mm256_add_epi8(lower, upper));
            }
            U8x32(sum)
        }
    }
}

impl PixelLoops for Avx2 {
    #[inline(always)]
    fn divide(self, divisor: Divisor, sums: &[[u16; 32]], quotients: &mut [u8]) {
        for (sums, quotients) in sums.iter().zip(quotients.as_chunks_mut().0) {
            // SAFETY: the token vouches for AVX2. Each half has as many sums as a register holds.
            let [low, high] = unsafe { [divide(divisor, sums.as_ptr()), divide(divisor, sums[16..].as_ptr())] };
            // Packing within halves restores the order of the disparities.
            //
            // SAFETY: the token vouches for AVX2.
            unsafe {
                let packed = _mm256_min_epu8(_mm256_packus_epi16(low, high), _mm256_set1_epi8(Divisor::LIMIT as i8));
                U8x32(packed).store(quotients);
            }
        }
    }

    #[inline(always)]
    fn winner(self, paths: u16, costs: &[[u8; 32]], excess: &[[u8; 32]]) -> (u16, usize) {
        // SAFETY: the token vouches for AVX2.
        unsafe {
            let factors = _mm256_set1_epi16((paths << 8 | 1) as i16);
            let mut least = _mm256_set1_epi16(-1);
            for (costs, excess) in costs.iter().zip(excess) {
                let [low, high] = path_sums(self.load_bytes(costs), self.load_bytes(excess), factors);
                least = _mm256_min_epu16(least, _mm256_min_epu16(low, high));
            }
            let half = _mm_min_epu16(_mm256_castsi256_si128(least), _mm256_extracti128_si256::<1>(least));
            let least = _mm_minpos_epu16(half);
            let equal = _mm256_broadcastw_epi16(least);
            let mut first = 0;
            for (j, (costs, excess)) in costs.iter().zip(excess).enumerate().rev() {
                let [low, high] = path_sums(self.load_bytes(costs), self.load_bytes(excess), factors);
                // Packing within halves restores the order.
                let equal = _mm256_packs_epi16(_mm256_cmpeq_epi16(low, equal), _mm256_cmpeq_epi16(high, equal));
                let mask = _mm256_movemask_epi8(equal) as u32;
                first = if mask != 0 { 32 * j + mask.trailing_zeros() as usize } else { first };
            }
            let least = _mm_cvtsi128_si32(least) as u16;
            (least, first)
        }
    }
}

impl RunLoops for Avx2 {}

impl ByteVector for U8x32 {
    type Memory = [u8; 32];

    #[inline(always)]
    fn store(self, costs: &mut [u8; 32]) {
        // SAFETY: a token made the vector, so the processor has AVX2. The store fills an array as long as a register.
        unsafe { _mm256_storeu_si256(costs.as_mut_ptr().cast(), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_adds_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_subs_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_min_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_max_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            let not_greater = _mm256_cmpeq_epi8(_mm256_max_epu8(self.0, other.0), other.0);
            U8x32(_mm256_blendv_epi8(then.0, otherwise.0, not_greater))
        }
    }

    #[inline(always)]
    fn halved(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_and_si256(_mm256_srli_epi16::<1>(self.0), _mm256_set1_epi8(0x7f)) })
    }

    #[inline(always)]
    fn third(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            // 43 / 128 is exact up to 127. A product has 16 bits.
            let factor = _mm256_set1_epi16(43);
            let even = _mm256_mullo_epi16(_mm256_and_si256(self.0, _mm256_set1_epi16(0xff)), factor);
            let odd = _mm256_mullo_epi16(_mm256_srli_epi16::<8>(self.0), factor);
            let odd = _mm256_andnot_si256(_mm256_set1_epi16(0xff), _mm256_slli_epi16::<1>(odd));
            U8x32(_mm256_or_si256(_mm256_srli_epi16::<7>(even), odd))
        }
    }

    #[inline(always)]
    fn least(self) -> u8 {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe { _mm_cvtsi128_si32(self.least_first()) as u8 }
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        U8x32(unsafe { _mm256_broadcastb_epi8(self.least_first()) })
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            let across = _mm256_permute2x128_si256::<0x21>(previous.0, self.0);
            U8x32(_mm256_alignr_epi8::<15>(self.0, across))
        }
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX2.
        unsafe {
            let across = _mm256_permute2x128_si256::<0x21>(self.0, next.0);
            U8x32(_mm256_alignr_epi8::<1>(across, self.0))
        }
    }
}
