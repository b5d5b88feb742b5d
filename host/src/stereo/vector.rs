//! Thirty-two lanes of 16 bits, with the instructions of each level.
//!
//! A vector is only made by a token of the core, and such a token only by who vouches for the processor: so the instructions exist.
//! Memory is only reached through arrays as large as the vector.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use multiscopic_core::kernel::Portable;
#[cfg(target_arch = "x86_64")]
use multiscopic_core::kernel::{Avx2, Avx512};

/// Lanes of a vector.
pub const LANES: usize = 32;

/// Who has such a token may use its vectors.
pub trait Vectors: Copy {
    /// Lanes of 16 bits.
    type Vector: Vector;

    /// The same in every lane.
    fn splat(self, value: u16) -> Self::Vector;
    /// From memory.
    fn load(self, values: &[u16; LANES]) -> Self::Vector;
    /// How many bits of each of the `others` differ from `one`.
    fn differing<const BYTES: usize>(self, one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> Self::Vector;
}

/// What is done with a vector, lane by lane.
pub trait Vector: Copy {
    /// Into memory.
    fn store(self, values: &mut [u16; LANES]);
    /// The lesser.
    fn min(self, other: Self) -> Self;
    /// The greater.
    fn max(self, other: Self) -> Self;
    /// The sum, at most `u16::MAX`.
    fn add(self, other: Self) -> Self;
    /// The difference, at least 0.
    fn sub(self, other: Self) -> Self;
    /// `then` where this is greater than `other`, `otherwise` elsewhere.
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self;
    /// The least of all lanes.
    fn least(self) -> u16;
    /// The lanes that equal those of `other`, as bits.
    fn equal(self, other: Self) -> u32;
}

/// The definition: what all other vectors do too.
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
    fn differing<const BYTES: usize>(self, one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> [u16; LANES] {
        let mut differing = [0; LANES];
        for (one, others) in one.iter().zip(others) {
            for (differing, other) in differing.iter_mut().zip(others) {
                *differing += (one ^ other).count_ones() as u16;
            }
        }
        differing
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
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].saturating_add(other[i]))
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].saturating_sub(other[i]))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        std::array::from_fn(|i| if self[i] > other[i] { then[i] } else { otherwise[i] })
    }

    #[inline(always)]
    fn least(self) -> u16 {
        self.into_iter().fold(u16::MAX, u16::min)
    }

    #[inline(always)]
    fn equal(self, other: Self) -> u32 {
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
    fn differing<const BYTES: usize>(self, one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> [u16; LANES] {
        Portable::<8, 1>.differing(one, others)
    }
}

/// The number of bits that differ, in bytes.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn differing<const BYTES: usize>(one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> __m256i {
    unsafe {
        // The bits of four bits.
        let counts = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
        let low = _mm256_set1_epi8(0xf);
        let mut sum = _mm256_setzero_si256();
        for byte in 0..BYTES {
            let others = _mm256_loadu_si256(others[byte].as_ptr().cast());
            let bits = _mm256_xor_si256(_mm256_set1_epi8(one[byte] as i8), others);
            let lower = _mm256_shuffle_epi8(counts, _mm256_and_si256(bits, low));
            let upper = _mm256_shuffle_epi8(counts, _mm256_and_si256(_mm256_srli_epi16::<4>(bits), low));
            sum = _mm256_add_epi8(sum, _mm256_add_epi8(lower, upper));
        }
        sum
    }
}

/// The least of eight lanes.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn least(lanes: __m128i) -> u16 {
    unsafe { _mm_extract_epi16::<0>(_mm_minpos_epu16(lanes)) as u16 }
}

/// In AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub struct Avx2Vector([__m256i; 2]);

#[cfg(target_arch = "x86_64")]
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
    fn differing<const BYTES: usize>(self, one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> Avx2Vector {
        unsafe {
            let bytes = differing(one, others);
            let low = _mm256_cvtepu8_epi16(_mm256_castsi256_si128(bytes));
            Avx2Vector([low, _mm256_cvtepu8_epi16(_mm256_extracti128_si256::<1>(bytes))])
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Avx2Vector {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(__m256i, __m256i) -> __m256i) -> Self {
        Avx2Vector([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

#[cfg(target_arch = "x86_64")]
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
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| unsafe { _mm256_adds_epu16(a, b) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
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
    fn least(self) -> u16 {
        unsafe {
            let half = _mm256_min_epu16(self.0[0], self.0[1]);
            least(_mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half)))
        }
    }

    #[inline(always)]
    fn equal(self, other: Self) -> u32 {
        unsafe {
            let equal = |i: usize| _mm256_cmpeq_epi16(self.0[i], other.0[i]);
            // Packing works in halves, so that their middle quarters change places.
            let packed = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(equal(0), equal(1)));
            _mm256_movemask_epi8(packed) as u32
        }
    }
}

/// In AVX-512.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub struct Avx512Vector(__m512i);

#[cfg(target_arch = "x86_64")]
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
    fn differing<const BYTES: usize>(self, one: [u8; BYTES], others: [&[u8; LANES]; BYTES]) -> Avx512Vector {
        Avx512Vector(unsafe { _mm512_cvtepu8_epi16(differing(one, others)) })
    }
}

#[cfg(target_arch = "x86_64")]
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
    fn add(self, other: Self) -> Self {
        Avx512Vector(unsafe { _mm512_adds_epu16(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
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
    fn least(self) -> u16 {
        unsafe {
            let half = _mm256_min_epu16(_mm512_castsi512_si256(self.0), _mm512_extracti64x4_epi64::<1>(self.0));
            least(_mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half)))
        }
    }

    #[inline(always)]
    fn equal(self, other: Self) -> u32 {
        unsafe { _mm512_cmpeq_epu16_mask(self.0, other.0) }
    }
}
