//! Sums of products of floats, with the vector instructions for them.
//!
//! Sums are fused multiply-adds in a fixed order, so all vectors that have these give the same bits: AVX2, AVX-512 and Neon.
//! Other processors round each product too.

use std::{array, fmt};

/// The outputs of a panel, which are computed together: two of the widest vectors.
pub const FLOAT_PANEL: usize = 32;

/// A value for each output of a panel, aligned to the widest vector.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct FloatLine(pub [f32; FLOAT_PANEL]);

/// Instructions for vectors of floats.
pub trait FloatVectors: Copy {
    /// The floats in a vector.
    const LANES: usize;
    /// A vector.
    type Vector: Copy;

    /// The vector with number `index` in a line.
    fn load(self, line: &FloatLine, index: usize) -> Self::Vector;

    /// Writes the vector with number `index` in a line.
    fn store(self, vector: Self::Vector, line: &mut FloatLine, index: usize);

    /// Adds the products of an input with its weights.
    fn add(self, sums: Self::Vector, input: f32, weights: Self::Vector) -> Self::Vector;
}

/// A computation that is generic over vectors.
pub trait FloatTask {
    /// Computes it with the sums of `POSITIONS` x `VECTORS` vectors at a time. With an input and its weights, they fill the
    /// registers.
    fn run<V: FloatVectors, const POSITIONS: usize, const VECTORS: usize>(self, vectors: V);
}

/// Instructions for sums of products of floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FloatSums(Instructions);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Fma,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
    Neon,
    Plain,
}

impl FloatSums {
    /// All that this processor has, the widest first.
    pub fn available() -> impl Iterator<Item = FloatSums> {
        let all = [
            #[cfg(target_arch = "x86_64")]
            is_x86_feature_detected!("avx512f").then_some(Instructions::Avx512),
            #[cfg(target_arch = "x86_64")]
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Instructions::Fma),
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Some(Instructions::Neon),
            Some(Instructions::Plain),
        ];
        all.into_iter().flatten().map(FloatSums)
    }

    /// Runs `task` with these instructions.
    pub fn run<T: FloatTask>(self, task: T) {
        match self.0 {
            // SAFETY: `available` has detected the instructions, and nothing else makes this value.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { x86::run_with_avx512(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Fma => unsafe { x86::run_with_fma(task) },
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => task.run::<_, 6, 4>(aarch64::Neon),
            Instructions::Plain => task.run::<_, 6, 2>(Plain),
        }
    }
}

impl fmt::Display for FloatSums {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Instructions::Fma => "fma",
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => "neon",
            Instructions::Plain => "plain",
        })
    }
}

/// Plain Rust.
#[derive(Clone, Copy)]
struct Plain;

impl FloatVectors for Plain {
    const LANES: usize = 4;
    type Vector = [f32; 4];

    #[inline(always)]
    fn load(self, line: &FloatLine, index: usize) -> [f32; 4] {
        line.0.as_chunks().0[index]
    }

    #[inline(always)]
    fn store(self, vector: [f32; 4], line: &mut FloatLine, index: usize) {
        line.0.as_chunks_mut().0[index] = vector;
    }

    #[inline(always)]
    fn add(self, sums: [f32; 4], input: f32, weights: [f32; 4]) -> [f32; 4] {
        array::from_fn(|lane| input * weights[lane] + sums[lane])
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{FloatLine, FloatTask, FloatVectors};

    /// AVX-512. Made by [`run_with_avx512`] alone, which is called where it was detected.
    #[derive(Clone, Copy)]
    pub struct Avx512(());

    /// AVX2 with fused multiply-adds. Made by [`run_with_fma`] alone, as above.
    #[derive(Clone, Copy)]
    pub struct Fma(());

    #[target_feature(enable = "avx512f")]
    pub fn run_with_avx512<T: FloatTask>(task: T) {
        task.run::<_, 14, 2>(Avx512(()));
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn run_with_fma<T: FloatTask>(task: T) {
        task.run::<_, 6, 2>(Fma(()));
    }

    impl FloatVectors for Avx512 {
        const LANES: usize = 16;
        type Vector = __m512;

        #[inline(always)]
        fn load(self, line: &FloatLine, index: usize) -> __m512 {
            let lanes: &[f32; 16] = &line.0.as_chunks().0[index];
            // SAFETY: AVX-512 is there; the 16 floats are 64 bytes.
            unsafe { _mm512_loadu_ps(lanes.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, vector: __m512, line: &mut FloatLine, index: usize) {
            let lanes: &mut [f32; 16] = &mut line.0.as_chunks_mut().0[index];
            // SAFETY: AVX-512 is there; the 16 floats are 64 bytes.
            unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), vector) }
        }

        #[inline(always)]
        fn add(self, sums: __m512, input: f32, weights: __m512) -> __m512 {
            // SAFETY: AVX-512 is there.
            unsafe { _mm512_fmadd_ps(_mm512_set1_ps(input), weights, sums) }
        }
    }

    impl FloatVectors for Fma {
        const LANES: usize = 8;
        type Vector = __m256;

        #[inline(always)]
        fn load(self, line: &FloatLine, index: usize) -> __m256 {
            let lanes: &[f32; 8] = &line.0.as_chunks().0[index];
            // SAFETY: AVX2 is there; the 8 floats are 32 bytes.
            unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, vector: __m256, line: &mut FloatLine, index: usize) {
            let lanes: &mut [f32; 8] = &mut line.0.as_chunks_mut().0[index];
            // SAFETY: AVX2 is there; the 8 floats are 32 bytes.
            unsafe { _mm256_storeu_ps(lanes.as_mut_ptr(), vector) }
        }

        #[inline(always)]
        fn add(self, sums: __m256, input: f32, weights: __m256) -> __m256 {
            // SAFETY: AVX2 and fused multiply-adds are there.
            unsafe { _mm256_fmadd_ps(_mm256_set1_ps(input), weights, sums) }
        }
    }
}

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod aarch64 {
    use std::arch::aarch64::*;

    use super::{FloatLine, FloatVectors};

    /// Neon, which the program is compiled for.
    #[derive(Clone, Copy)]
    pub struct Neon;

    impl FloatVectors for Neon {
        const LANES: usize = 4;
        type Vector = float32x4_t;

        #[inline(always)]
        fn load(self, line: &FloatLine, index: usize) -> float32x4_t {
            let lanes: &[f32; 4] = &line.0.as_chunks().0[index];
            // SAFETY: the program is compiled for Neon; the 4 floats are 16 bytes.
            unsafe { vld1q_f32(lanes.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, vector: float32x4_t, line: &mut FloatLine, index: usize) {
            let lanes: &mut [f32; 4] = &mut line.0.as_chunks_mut().0[index];
            // SAFETY: the program is compiled for Neon; the 4 floats are 16 bytes.
            unsafe { vst1q_f32(lanes.as_mut_ptr(), vector) }
        }

        #[inline(always)]
        fn add(self, sums: float32x4_t, input: f32, weights: float32x4_t) -> float32x4_t {
            // SAFETY: the program is compiled for Neon.
            unsafe { vfmaq_f32(sums, vdupq_n_f32(input), weights) }
        }
    }
}
