//! The processor's runtime: the entry, the critical section, the handler of faults, and how deep the stack was.

#[cfg(target_arch = "arm")]
mod cortex_m;
#[cfg(target_arch = "riscv32")]
mod risc_v;

#[cfg(target_arch = "arm")]
pub use cortex_m::{entry, stack_depth};
#[cfg(target_arch = "riscv32")]
pub use risc_v::{entry, stack_depth};
