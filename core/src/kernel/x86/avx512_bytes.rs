//! AVX-512: costs in 8-bit lanes. Unsafe code is sound as in [`avx512`](super::avx512).
#![allow(unsafe_code)]

use core::arch::x86_64::*;

use super::Avx512;
use crate::kernel::bytes::{ByteVector, Bytes, Divisor, PixelLoops, RunLoops};

/// 64 lanes of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct U8x64(__m512i);

impl U8x64 {
    /// The least of all lanes, in the first.
    ///
    /// # Safety
    /// The processor has AVX-512.
    #[inline(always)]
    unsafe fn least_first(self) -> __m128i {
        // SAFETY: the caller vouches for AVX-512.
        unsafe {
            let half = _mm256_min_epu8(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            let quarter = _mm_min_epu8(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half));
            _mm_minpos_epu16(_mm_min_epu8(quarter, _mm_srli_epi16::<8>(quarter)))
        }
    }
}

/// `factors` are 1 and the number of paths, in turns. Those times the excess and the costs, in 16 bits: the sums of
/// the lower and the upper half of each quarter of the lanes.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn path_sums(costs: U8x64, excess: U8x64, factors: __m512i) -> [__m512i; 2] {
    // SAFETY: the caller vouches for AVX-512.
    unsafe {
        let (low, high) = (_mm512_unpacklo_epi8(excess.0, costs.0), _mm512_unpackhi_epi8(excess.0, costs.0));
        [_mm512_maddubs_epi16(low, factors), _mm512_maddubs_epi16(high, factors)]
    }
}

/// Divides sums: [`Divisor::divide`], but for the limit of quotients of three.
///
/// # Safety
/// The processor has AVX-512, and `sums` points to as many sums as a register holds.
#[inline(always)]
unsafe fn divide(divisor: Divisor, sums: *const u16) -> __m512i {
    // SAFETY: the caller vouches for AVX-512 and for the sums.
    unsafe {
        let sums = _mm512_loadu_si512(sums.cast());
        let shifted = _mm512_srl_epi16(sums, _mm_cvtsi32_si128(divisor.shift as i32));
        if divisor.by_three {
            let limited = _mm512_min_epu16(shifted, _mm512_set1_epi16(Divisor::MOST_THIRDS as i16));
            _mm512_srli_epi16::<9>(_mm512_mullo_epi16(limited, _mm512_set1_epi16(171)))
        } else {
            _mm512_min_epu16(shifted, _mm512_set1_epi16(Divisor::LIMIT.into()))
        }
    }
}

impl Bytes for Avx512 {
    type Bytes = U8x64;

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 64]) -> U8x64 {
        // SAFETY: the token vouches for AVX-512. The load reads an array as long as a register.
        U8x64(unsafe { _mm512_loadu_si512(costs.as_ptr().cast()) })
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> U8x64 {
        // SAFETY: the token vouches for AVX-512.
        U8x64(unsafe { _mm512_set1_epi8(cost as i8) })
    }

    #[inline(always)]
    fn byte_indices(self) -> U8x64 {
        self.load_bytes(&core::array::from_fn(|i| i as u8))
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 64]; N]) -> U8x64 {
        // SAFETY: the token vouches for AVX-512. The load reads an array as long as a register.
        unsafe {
            // The number of set bits of each four-bit number.
            let counts = _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
            let low = _mm512_set1_epi8(0xf);
            let mut sum = _mm512_setzero_si512();
            for byte in 0..N {
                let others = _mm512_loadu_si512(others[byte].as_ptr().cast());
                let bits = _mm512_xor_si512(_mm512_set1_epi8(descriptor[byte] as i8), others);
                let lower = _mm512_shuffle_epi8(counts, _mm512_and_si512(bits, low));
                let upper = _mm512_shuffle_epi8(counts, _mm512_and_si512(_mm512_srli_epi16::<4>(bits), low));
                sum = _mm512_add_epi8(sum, _mm512_add_epi8(lower, upper));
            }
            U8x64(sum)
        }
    }
}

impl PixelLoops for Avx512 {
    #[inline(always)]
    fn divide(self, divisor: Divisor, sums: &[[u16; 64]], quotients: &mut [u8]) {
        for (sums, quotients) in sums.iter().zip(quotients.as_chunks_mut().0) {
            // SAFETY: the token vouches for AVX-512. Each half has as many sums as a register holds.
            let [low, high] = unsafe { [divide(divisor, sums.as_ptr()), divide(divisor, sums[32..].as_ptr())] };
            // Packing within quarters restores the order of the disparities.
            //
            // SAFETY: the token vouches for AVX-512.
            unsafe {
                let packed = _mm512_min_epu8(_mm512_packus_epi16(low, high), _mm512_set1_epi8(Divisor::LIMIT as i8));
                U8x64(packed).store(quotients);
            }
        }
    }

    #[inline(always)]
    fn winner(self, paths: u16, costs: &[[u8; 64]], excess: &[[u8; 64]]) -> (u16, usize) {
        // SAFETY: the token vouches for AVX-512.
        unsafe {
            let factors = _mm512_set1_epi16((paths << 8 | 1) as i16);
            let mut least = _mm512_set1_epi16(-1);
            for (costs, excess) in costs.iter().zip(excess) {
                let [low, high] = path_sums(self.load_bytes(costs), self.load_bytes(excess), factors);
                least = _mm512_min_epu16(least, _mm512_min_epu16(low, high));
            }
            let half = _mm256_min_epu16(_mm512_castsi512_si256(least), _mm512_extracti64x4_epi64::<1>(least));
            let quarter = _mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half));
            let least = _mm_minpos_epu16(quarter);
            let equal = _mm512_broadcastw_epi16(least);
            let mut first = 0;
            for (j, (costs, excess)) in costs.iter().zip(excess).enumerate().rev() {
                let [low, high] = path_sums(self.load_bytes(costs), self.load_bytes(excess), factors);
                // Packing within quarters restores the order. Zero where the sum is the least.
                let above = _mm512_packus_epi16(_mm512_sub_epi16(low, equal), _mm512_sub_epi16(high, equal));
                let mask = _mm512_testn_epi8_mask(above, above);
                first = if mask != 0 { 64 * j + mask.trailing_zeros() as usize } else { first };
            }
            let least = _mm_cvtsi128_si32(least) as u16;
            (least, first)
        }
    }
}

impl RunLoops for Avx512 {}

impl ByteVector for U8x64 {
    type Memory = [u8; 64];

    #[inline(always)]
    fn store(self, costs: &mut [u8; 64]) {
        // SAFETY: a token made the vector, so the processor has AVX-512. The store fills an array as long as a register.
        unsafe { _mm512_storeu_si512(costs.as_mut_ptr().cast(), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_adds_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_subs_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_min_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_max_epu8(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe { U8x64(_mm512_mask_blend_epi8(_mm512_cmpgt_epu8_mask(self.0, other.0), otherwise.0, then.0)) }
    }

    #[inline(always)]
    fn halved(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_and_si512(_mm512_srli_epi16::<1>(self.0), _mm512_set1_epi8(0x7f)) })
    }

    #[inline(always)]
    fn third(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe {
            // 43 / 128 is exact up to 127. A product has 16 bits.
            let factor = _mm512_set1_epi16(43);
            let even = _mm512_mullo_epi16(_mm512_and_si512(self.0, _mm512_set1_epi16(0xff)), factor);
            let odd = _mm512_mullo_epi16(_mm512_srli_epi16::<8>(self.0), factor);
            let odd = _mm512_andnot_si512(_mm512_set1_epi16(0xff), _mm512_slli_epi16::<1>(odd));
            U8x64(_mm512_or_si512(_mm512_srli_epi16::<7>(even), odd))
        }
    }

    #[inline(always)]
    fn least(self) -> u8 {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe { _mm_cvtsi128_si32(self.least_first()) as u8 }
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        U8x64(unsafe { _mm512_broadcastb_epi8(self.least_first()) })
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe {
            let across = _mm512_alignr_epi64::<6>(self.0, previous.0);
            U8x64(_mm512_alignr_epi8::<15>(self.0, across))
        }
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        // SAFETY: a token made the vector, so the processor has AVX-512.
        unsafe {
            let across = _mm512_alignr_epi64::<2>(next.0, self.0);
            U8x64(_mm512_alignr_epi8::<1>(across, self.0))
        }
    }
}
