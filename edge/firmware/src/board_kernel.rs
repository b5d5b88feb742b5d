//! The matcher's kernel for the processor of the board.

#[cfg(target_arch = "arm")]
use multiscopic_core::kernel;
use multiscopic_core::kernel::{Isa, Portable};

/// The kernel of a Cortex-M4, M7 or M33, with their DSP instructions.
#[cfg(all(target_arch = "arm", not(feature = "an547")))]
pub type BoardKernel = kernel::Dsp;

/// The kernel of a Cortex-M55, with its vector extension.
#[cfg(all(target_arch = "arm", feature = "an547"))]
pub type BoardKernel = kernel::Mve;

/// The kernel of processors without vector instructions, such as those of RISC-V.
#[cfg(not(target_arch = "arm"))]
pub type BoardKernel = Twin;

/// Its portable twin, which has the same memory layout on a host.
type Twin = Portable<8>;

const _: () = assert!(BoardKernel::LANES == Twin::LANES && BoardKernel::BATCH == Twin::BATCH);
