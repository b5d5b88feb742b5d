//! The matcher's kernel for the processor of the board.

use multiscopic_core::kernel::{self, Isa, Portable};

/// The kernel of a Cortex-M4, M7 or M33, with their DSP instructions.
#[cfg(not(feature = "an547"))]
pub type BoardKernel = kernel::Dsp;

/// The kernel of a Cortex-M55, with its vector extension.
#[cfg(feature = "an547")]
pub type BoardKernel = kernel::Mve;

/// Its portable twin, which has the same memory layout on a host.
type Twin = Portable<8>;

const _: () = assert!(BoardKernel::LANES == Twin::LANES && BoardKernel::BATCH == Twin::BATCH);
