//! Vectors in AVX2 and AVX-512.
//!
//! # Safety
//! All unsafe code of this module is sound for two reasons:
//!
//! - The processor has the instructions. Every operation takes an [`Avx2`] or [`Avx512`] token, or a vector
//!   that was made with one. To make a token is unsafe, and vouches for the features that it names. The
//!   vectors' fields are private, so nothing else makes vectors.
//! - Memory accesses stay in bounds. Every load and store goes through a reference to an array of [`LANES`]
//!   values and covers all of it, or its first or last half. None of these instructions needs alignment.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use std::arch::x86_64::*;

use multiscopic_core::kernel::{Avx2, Avx512};

use super::definition::{LANES, Vector, Vectors};

/// The Hamming distances of a descriptor and 32 others, as bytes.
///
/// # Safety
/// The processor must have AVX2.
#[inline(always)]
unsafe fn hamming_bytes<const BYTES: usize>(descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> __m256i {
    unsafe {
        // The number of set bits of each four-bit number.
        let counts = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
        let low = _mm256_set1_epi8(0xf);
        let mut sum = _mm256_setzero_si256();
        for byte in 0..BYTES {
            let others = _mm256_loadu_si256(descriptors[byte].as_ptr().cast());
            let bits = _mm256_xor_si256(_mm256_set1_epi8(descriptor[byte] as i8), others);
            let lower = _mm256_shuffle_epi8(counts, _mm256_and_si256(bits, low));
            let upper = _mm256_shuffle_epi8(counts, _mm256_and_si256(_mm256_srli_epi16::<4>(bits), low));
            sum = _mm256_add_epi8(sum, _mm256_add_epi8(lower, upper));
        }
        sum
    }
}

/// The minimum of eight lanes.
///
/// # Safety
/// The processor must have SSE4.1, which is part of AVX2.
#[inline(always)]
unsafe fn min_of_eight(lanes: __m128i) -> u16 {
    unsafe { _mm_extract_epi16::<0>(_mm_minpos_epu16(lanes)) as u16 }
}

/// A vector in two registers of AVX2.
#[derive(Clone, Copy, Debug)]
pub struct Avx2Vector([__m256i; 2]);

impl Vectors for Avx2 {
    type Vector = Avx2Vector;

    #[inline(always)]
    fn splat(self, value: u16) -> Avx2Vector {
        Avx2Vector([unsafe { _mm256_set1_epi16(value as i16) }; 2])
    }

    #[inline(always)]
    fn load(self, values: &[u16; LANES]) -> Avx2Vector {
        let load = |i: usize| unsafe { _mm256_loadu_si256(values[i..].as_ptr().cast()) };
        Avx2Vector([load(0), load(16)])
    }

    #[inline(always)]
    fn hamming_distances<const BYTES: usize>(self, descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> Avx2Vector {
        unsafe {
            let bytes = hamming_bytes(descriptor, descriptors);
            let low = _mm256_cvtepu8_epi16(_mm256_castsi256_si128(bytes));
            Avx2Vector([low, _mm256_cvtepu8_epi16(_mm256_extracti128_si256::<1>(bytes))])
        }
    }
}

impl Avx2Vector {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        Avx2Vector([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

impl Vector for Avx2Vector {
    #[inline(always)]
    fn store(self, values: &mut [u16; LANES]) {
        unsafe {
            _mm256_storeu_si256(values.as_mut_ptr().cast(), self.0[0]);
            _mm256_storeu_si256(values[16..].as_mut_ptr().cast(), self.0[1]);
        }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_min_epu16(a, b) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_max_epu16(a, b) })
    }

    #[inline(always)]
    fn saturating_add(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_adds_epu16(a, b) })
    }

    #[inline(always)]
    fn saturating_sub(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_subs_epu16(a, b) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |i: usize| unsafe {
            let not_greater = _mm256_cmpeq_epi16(_mm256_max_epu16(self.0[i], other.0[i]), other.0[i]);
            _mm256_blendv_epi8(then.0[i], otherwise.0[i], not_greater)
        };
        Avx2Vector([choose(0), choose(1)])
    }

    #[inline(always)]
    fn min_lane(self) -> u16 {
        unsafe {
            let half = _mm256_min_epu16(self.0[0], self.0[1]);
            min_of_eight(_mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half)))
        }
    }

    #[inline(always)]
    fn equal_mask(self, other: Self) -> u32 {
        unsafe {
            let equal = |i: usize| _mm256_cmpeq_epi16(self.0[i], other.0[i]);
            // Packing works within halves of 128 bits. The permutation puts its quarters into the order of
            // the lanes.
            let packed = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(equal(0), equal(1)));
            _mm256_movemask_epi8(packed) as u32
        }
    }
}

/// A vector in a register of AVX-512.
#[derive(Clone, Copy, Debug)]
pub struct Avx512Vector(__m512i);

impl Vectors for Avx512 {
    type Vector = Avx512Vector;

    #[inline(always)]
    fn splat(self, value: u16) -> Avx512Vector {
        Avx512Vector(unsafe { _mm512_set1_epi16(value as i16) })
    }

    #[inline(always)]
    fn load(self, values: &[u16; LANES]) -> Avx512Vector {
        Avx512Vector(unsafe { _mm512_loadu_si512(values.as_ptr().cast()) })
    }

    #[inline(always)]
    fn hamming_distances<const BYTES: usize>(self, descriptor: [u8; BYTES], descriptors: [&[u8; LANES]; BYTES]) -> Avx512Vector {
        Avx512Vector(unsafe { _mm512_cvtepu8_epi16(hamming_bytes(descriptor, descriptors)) })
    }
}

impl Vector for Avx512Vector {
    #[inline(always)]
    fn store(self, values: &mut [u16; LANES]) {
        unsafe { _mm512_storeu_si512(values.as_mut_ptr().cast(), self.0) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Avx512Vector(unsafe { _mm512_min_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Avx512Vector(unsafe { _mm512_max_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn saturating_add(self, other: Self) -> Self {
        Avx512Vector(unsafe { _mm512_adds_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn saturating_sub(self, other: Self) -> Self {
        Avx512Vector(unsafe { _mm512_subs_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        unsafe {
            let greater = _mm512_cmpgt_epu16_mask(self.0, other.0);
            Avx512Vector(_mm512_mask_blend_epi16(greater, otherwise.0, then.0))
        }
    }

    #[inline(always)]
    fn min_lane(self) -> u16 {
        unsafe {
            let half = _mm256_min_epu16(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            min_of_eight(_mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half)))
        }
    }

    #[inline(always)]
    fn equal_mask(self, other: Self) -> u32 {
        unsafe { _mm512_cmpeq_epu16_mask(self.0, other.0) }
    }
}
