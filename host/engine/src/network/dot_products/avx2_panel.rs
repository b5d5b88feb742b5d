//! Sums of products by AVX2.

use std::arch::x86_64::*;

use super::panel::{PANEL, Panel, PanelTask, WeightLine};

/// AVX2, 8 outputs in each of its vectors. Made by [`run`] alone, which is called where AVX2 was detected.
#[derive(Clone, Copy, Debug)]
pub struct Avx2Panel<const VECTORS: usize>(());

/// Runs `task` with AVX2.
#[target_feature(enable = "avx2")]
pub fn run<T: PanelTask>(task: T) {
    // 16 registers hold the sums of 4 positions, 2 vectors of weights, and what a step needs.
    task.run::<_, _, 4, 8>(Avx2Panel::<2>(()), Avx2Panel::<1>(()));
}

impl<const VECTORS: usize> Panel for Avx2Panel<VECTORS> {
    const OUTPUTS: usize = 8 * VECTORS;
    type Sums = [__m256i; VECTORS];
    type Weights = [__m256i; VECTORS];

    #[inline(always)]
    fn load(self, sums: &[i32; PANEL]) -> Self::Sums {
        std::array::from_fn(|i| {
            let sums: &[i32; 8] = sums[8 * i..][..8].try_into().expect("8 of them");
            // SAFETY: AVX2 is there; the 8 sums are 32 bytes.
            unsafe { _mm256_loadu_si256(sums.as_ptr().cast()) }
        })
    }

    #[inline(always)]
    fn store(self, sums: Self::Sums, out: &mut [i32; PANEL]) {
        for (sums, out) in sums.iter().zip(out.as_chunks_mut::<8>().0) {
            // SAFETY: AVX2 is there; the 8 sums are 32 bytes.
            unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), *sums) }
        }
    }

    #[inline(always)]
    fn weights(self, line: &WeightLine) -> Self::Weights {
        std::array::from_fn(|i| {
            let weights: &[i8; 32] = line.0[32 * i..][..32].try_into().expect("32 of them");
            // SAFETY: AVX2 is there; the 32 weights are 32 bytes.
            unsafe { _mm256_loadu_si256(weights.as_ptr().cast()) }
        })
    }

    #[inline(always)]
    fn add(self, sums: Self::Sums, inputs: [u8; 4], weights: Self::Weights) -> Self::Sums {
        std::array::from_fn(|i| {
            // SAFETY: AVX2 is there.
            unsafe {
                let inputs = _mm256_set1_epi32(i32::from_le_bytes(inputs));
                // Inputs are at most 127, so the sums of two products do not saturate.
                let pairs = _mm256_maddubs_epi16(inputs, weights[i]);
                _mm256_add_epi32(sums[i], _mm256_madd_epi16(pairs, _mm256_set1_epi16(1)))
            }
        })
    }
}
