//! The portable twin, its comparison with a kernel, and the random numbers that both get.

use core::fmt::Debug;
use multiscopic_core::kernel::{Isa, Native, Portable};
use semihosting::eprintln;

/// The lanes of both kernels.
pub const LANES: usize = Native::LANES;

/// The portable kernel, which defines what every operation does.
pub type Twin = Portable<LANES>;

/// A difference was found and printed.
pub struct Difference;

/// Prints the result of an operation if it is not the twin's.
///
/// # Errors
/// The results differ.
pub fn same<T: PartialEq + Debug>(name: &str, found: T, expected: T) -> Result<(), Difference> {
    if found == expected {
        return Ok(());
    }
    eprintln!("kernels: {name} is {found:?}, the portable one {expected:?}");
    Err(Difference)
}

/// Marsaglia's xorshift with 32 bits of state, which must not be 0: the same numbers in every run.
pub struct Xorshift(pub u32);

impl Xorshift {
    pub fn number(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }
}
