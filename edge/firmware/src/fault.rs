//! Ends the firmware after an error, a panic or a fault, with a message and an exit code.
//!
//! After a panic or a fault the log may be broken, so these messages are plain text.

use core::{
    fmt::{Arguments, Display},
    panic::PanicInfo,
};
use semihosting::{eprintln, process};

const FAILED: i32 = 1;
const PANICKED: i32 = 101;
const FAULTED: i32 = 102;
const OVERFLOWED: i32 = 103;

/// Ends the firmware because of `error`.
pub fn fail(error: impl Display) -> ! {
    defmt::error!("{}", defmt::Display2Format(&error));
    process::exit(FAILED)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    eprintln!("firmware: {info}");
    process::exit(PANICKED)
}

/// Ends the firmware after a fault with a stack of so many bytes, whose pointer was beyond it.
pub fn overflowed(bytes: u32, stack_pointer: u32) -> ! {
    eprintln!("firmware: stack overflow: the stack has {bytes} bytes, and the stack pointer is at {stack_pointer:#010x}");
    process::exit(OVERFLOWED)
}

/// Ends the firmware after another fault.
pub fn faulted(fault: Arguments<'_>) -> ! {
    eprintln!("firmware: {fault}");
    process::exit(FAULTED)
}
