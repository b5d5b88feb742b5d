//! Sums of products by Neon.
//!
//! The instructions for dot products of bytes are not stable in Rust yet. Widening products take about four
//! instructions in place of one.

use std::arch::aarch64::*;

use super::panel::{PANEL, Panel, PanelTask, WeightLine};

/// Neon, 4 outputs in each of its vectors.
#[derive(Clone, Copy, Debug)]
pub struct NeonPanel<const VECTORS: usize>;

/// Runs `task` with Neon, which this program was compiled for.
pub fn run<T: PanelTask>(task: T) {
    task.run::<_, _, 4, 8>(NeonPanel::<4>, NeonPanel::<2>);
}

impl<const VECTORS: usize> Panel for NeonPanel<VECTORS> {
    const OUTPUTS: usize = 4 * VECTORS;
    type Sums = [int32x4_t; VECTORS];
    type Weights = [int8x16_t; VECTORS];

    #[inline(always)]
    fn load(self, sums: &[i32; PANEL]) -> Self::Sums {
        std::array::from_fn(|i| {
            let sums: &[i32; 4] = sums[4 * i..][..4].try_into().expect("4 of them");
            // SAFETY: the program is compiled for Neon; the 4 sums are 16 bytes.
            unsafe { vld1q_s32(sums.as_ptr()) }
        })
    }

    #[inline(always)]
    fn store(self, sums: Self::Sums, out: &mut [i32; PANEL]) {
        for (sums, out) in sums.iter().zip(out.as_chunks_mut::<4>().0) {
            // SAFETY: the program is compiled for Neon; the 4 sums are 16 bytes.
            unsafe { vst1q_s32(out.as_mut_ptr(), *sums) }
        }
    }

    #[inline(always)]
    fn weights(self, line: &WeightLine) -> Self::Weights {
        std::array::from_fn(|i| {
            let weights: &[i8; 16] = line.0[16 * i..][..16].try_into().expect("16 of them");
            // SAFETY: the program is compiled for Neon; the 16 weights are 16 bytes.
            unsafe { vld1q_s8(weights.as_ptr()) }
        })
    }

    #[inline(always)]
    fn add(self, sums: Self::Sums, inputs: [u8; 4], weights: Self::Weights) -> Self::Sums {
        std::array::from_fn(|i| {
            // SAFETY: the program is compiled for Neon.
            unsafe {
                let inputs = vreinterpretq_s8_s32(vdupq_n_s32(i32::from_le_bytes(inputs)));
                let low = vmull_s8(vget_low_s8(inputs), vget_low_s8(weights[i]));
                let high = vmull_high_s8(inputs, weights[i]);
                // Inputs are at most 127, so the sums of two products fit 16 bits.
                vpadalq_s16(sums[i], vpaddq_s16(low, high))
            }
        })
    }
}
