//! The vectors that the firmware matches with.

/// The instruction set of the processor that the firmware is built for.
#[cfg(all(target_arch = "arm", not(feature = "an547")))]
pub type Kernel = multiscopic_core::kernel::Dsp;

/// The instruction set of the processor that the firmware is built for.
#[cfg(not(all(target_arch = "arm", not(feature = "an547"))))]
pub type Kernel = multiscopic_core::kernel::Portable<{ multiscopic_core::Params::LANES }>;
