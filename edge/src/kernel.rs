//! The vectors that the firmware matches with.

use multiscopic_core::{Params, kernel::Portable};

/// The instruction set of the processor that the firmware is built for.
pub type Kernel = Portable<{ Params::LANES }>;
