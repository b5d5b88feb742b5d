//! How the firmware ends when it cannot go on: with words and an exit code, never in a silent loop.
#![expect(unsafe_code, reason = "an exception handler is declared unsafe")]

use core::{fmt::Display, panic::PanicInfo};
use cortex_m_rt::{ExceptionFrame, exception};
use semihosting::{eprintln, process};

const FAILED: i32 = 1;
const PANICKED: i32 = 101;
const FAULTED: i32 = 102;

/// Ends the firmware because of `error`.
pub fn fail(error: impl Display) -> ! {
    eprintln!("firmware: {error}");
    process::exit(FAILED)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    eprintln!("firmware: {info}");
    process::exit(PANICKED)
}

// SAFETY: the handler runs instead of what faulted, and touches nothing that it could have left half-done.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    eprintln!("firmware: hard fault at {:#010x}", frame.pc());
    process::exit(FAULTED)
}
