//! The vectors that the firmware matches with.

use multiscopic_core::kernel;
#[cfg(target_arch = "arm")]
use multiscopic_core::kernel::Isa;

/// The instruction set of the processor that the firmware is built for.
#[cfg(all(target_arch = "arm", not(feature = "an547")))]
pub type Kernel = kernel::Dsp;

/// The instruction set of the processor that the firmware is built for.
#[cfg(all(target_arch = "arm", feature = "an547"))]
pub type Kernel = kernel::Mve;

/// The instruction set of the processor that the firmware is built for.
#[cfg(not(target_arch = "arm"))]
pub type Kernel = kernel::Portable<{ multiscopic_core::Params::LANES }>;

/// A kernel with the lanes of both, and so with their memory, on any machine.
pub type Wide = kernel::Portable<8>;

#[cfg(target_arch = "arm")]
const _: () = assert!(Kernel::LANES == Wide::LANES && Kernel::BATCH == Wide::BATCH);
