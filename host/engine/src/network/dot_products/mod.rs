//! Sums of products of bytes, and of floats, with the vector instructions for them.
//!
//! A *panel* computes the sums of 8 or 16 outputs together. In each step it adds the products of 4 inputs with their
//! weights to each output. Inputs are at most 127, so that all instructions give the same sums: two products never
//! exceed 16 bits.
//!
//! | module | what it is |
//! | --- | --- |
//! | `panel` | the trait of all panels, and a row of outputs that any of them can compute |
//! | `plain_panel` | plain Rust, which defines the sums |
//! | `avx2_panel` | AVX2: products in 16 bits, added in pairs twice |
//! | `vnni_panel` | AVX-512 with VNNI: one instruction for a step |
//! | `neon_panel` | Neon: widening products |
//! | `float_sums` | floats, with all instructions |
#![allow(unsafe_code)]

#[cfg(target_arch = "x86_64")]
mod avx2_panel;
mod float_sums;
#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod neon_panel;
mod panel;
mod plain_panel;
#[cfg(target_arch = "x86_64")]
mod vnni_panel;

use std::fmt;

pub(super) use float_sums::{FLOAT_PANEL, FloatLine, FloatSums, FloatTask, FloatVectors};
pub(super) use panel::{PANEL, Panel, PanelTask, WeightLine};
use plain_panel::PlainPanel;

use crate::{engine::Engine, simd::Simd};

/// Instructions for sums of products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DotProducts(Instructions);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Vnni,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
    Neon,
    Plain,
}

impl DotProducts {
    /// The best instructions that go with a set of vector instructions.
    pub fn with(simd: Simd) -> DotProducts {
        #[cfg(target_arch = "x86_64")]
        {
            if Simd::named("avx512") == Some(simd) && vnni_panel::is_detected() {
                return DotProducts(Instructions::Vnni);
            }
            if simd != Simd::BASELINE && is_x86_feature_detected!("avx2") {
                return DotProducts(Instructions::Avx2);
            }
        }
        #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
        if simd != Simd::BASELINE {
            return DotProducts(Instructions::Neon);
        }
        let _ = simd;
        DotProducts(Instructions::Plain)
    }

    /// The instructions by which an engine runs the network.
    pub fn of(engine: &Engine) -> DotProducts {
        DotProducts::with(engine.widest())
    }

    /// Runs `task` with these instructions.
    pub(super) fn run<T: PanelTask>(self, task: T) {
        match self.0 {
            // SAFETY: `with` has detected the instructions, and nothing else makes this value.
            #[cfg(target_arch = "x86_64")]
            Instructions::Vnni => unsafe { vnni_panel::run(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { avx2_panel::run(task) },
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => neon_panel::run(task),
            Instructions::Plain => task.run::<_, _, 2, 2>(PlainPanel::<16>, PlainPanel::<8>),
        }
    }
}

impl fmt::Display for DotProducts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            #[cfg(target_arch = "x86_64")]
            Instructions::Vnni => "vnni",
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => "avx2",
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => "neon",
            Instructions::Plain => "plain",
        })
    }
}
