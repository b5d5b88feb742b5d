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

/// A kernel with the lanes of Cortex-M4's and M7's, and so with its memory, on any machine.
pub type Narrow = kernel::Portable<4>;

/// A kernel with the lanes of Cortex-M55's, and so with its memory, on any machine.
pub type Wide = kernel::Portable<8>;

#[cfg(all(target_arch = "arm", not(feature = "an547")))]
const _: () = assert!(Kernel::LANES == Narrow::LANES && Kernel::BATCH == Narrow::BATCH);
#[cfg(all(target_arch = "arm", feature = "an547"))]
const _: () = assert!(Kernel::LANES == Wide::LANES && Kernel::BATCH == Wide::BATCH);
