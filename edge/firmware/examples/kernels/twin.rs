//! The portable twin, and how a kernel is compared with it.

use core::fmt::Debug;
use multiscopic_core::kernel::{Isa, Portable};
use multiscopic_firmware::BoardKernel;
use semihosting::eprintln;

/// The lanes of both kernels.
pub const LANES: usize = BoardKernel::LANES;

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
