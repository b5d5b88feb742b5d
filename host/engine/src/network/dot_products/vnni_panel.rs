//! Sums of products by AVX-512 with VNNI.

use std::arch::x86_64::*;

use super::panel::{PANEL, Panel, PanelTask, WeightLine};

/// Returns true if this processor has all of the instructions.
pub fn is_detected() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512vnni")
}

/// 16 outputs in a vector. Made by [`run`] alone, which is called where the instructions were [detected](is_detected).
#[derive(Clone, Copy, Debug)]
pub struct WideVnniPanel(());

/// 8 outputs in half a vector. Made by [`run`] alone, as above.
#[derive(Clone, Copy, Debug)]
pub struct NarrowVnniPanel(());

/// Runs `task` with VNNI.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
pub fn run<T: PanelTask>(task: T) {
    task.run::<_, _, 8, 8>(WideVnniPanel(()), NarrowVnniPanel(()));
}

impl Panel for WideVnniPanel {
    const OUTPUTS: usize = 16;
    type Sums = __m512i;
    type Weights = __m512i;

    #[inline(always)]
    fn load(self, sums: &[i32; PANEL]) -> __m512i {
        // SAFETY: the instructions are there; the 16 sums are 64 bytes.
        unsafe { _mm512_loadu_si512(sums.as_ptr().cast()) }
    }

    #[inline(always)]
    fn store(self, sums: __m512i, out: &mut [i32; PANEL]) {
        // SAFETY: the instructions are there; the 16 sums are 64 bytes.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), sums) }
    }

    #[inline(always)]
    fn weights(self, line: &WeightLine) -> __m512i {
        // SAFETY: the instructions are there; the line has 64 bytes.
        unsafe { _mm512_loadu_si512(line.0.as_ptr().cast()) }
    }

    #[inline(always)]
    fn add(self, sums: __m512i, inputs: [u8; 4], weights: __m512i) -> __m512i {
        // SAFETY: the instructions are there.
        unsafe { _mm512_dpbusd_epi32(sums, _mm512_set1_epi32(i32::from_le_bytes(inputs)), weights) }
    }
}

impl Panel for NarrowVnniPanel {
    const OUTPUTS: usize = 8;
    type Sums = __m256i;
    type Weights = __m256i;

    #[inline(always)]
    fn load(self, sums: &[i32; PANEL]) -> __m256i {
        // SAFETY: the instructions are there; 8 of the sums are 32 bytes.
        unsafe { _mm256_loadu_si256(sums.as_ptr().cast()) }
    }

    #[inline(always)]
    fn store(self, sums: __m256i, out: &mut [i32; PANEL]) {
        // SAFETY: the instructions are there; 8 of the sums are 32 bytes.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), sums) }
    }

    #[inline(always)]
    fn weights(self, line: &WeightLine) -> __m256i {
        // SAFETY: the instructions are there; half of the line has 32 bytes.
        unsafe { _mm256_loadu_si256(line.0.as_ptr().cast()) }
    }

    #[inline(always)]
    fn add(self, sums: __m256i, inputs: [u8; 4], weights: __m256i) -> __m256i {
        // SAFETY: the instructions are there.
        unsafe { _mm256_dpbusd_epi32(sums, _mm256_set1_epi32(i32::from_le_bytes(inputs)), weights) }
    }
}
