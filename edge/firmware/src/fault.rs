//! Ends the firmware after an error, a panic or a fault, with a message and an exit code.
//!
//! After a panic or a fault the log may be broken, so these messages are plain text.
#![expect(unsafe_code, reason = "a fault handler replaces the stack and reads a register of the processor")]

use core::{arch::naked_asm, fmt::Display, panic::PanicInfo};
use cortex_m::peripheral::SCB;
use semihosting::{eprintln, process};

const FAILED: i32 = 1;
const PANICKED: i32 = 101;
const FAULTED: i32 = 102;
const OVERFLOWED: i32 = 103;

/// The bits of the Configurable Fault Status Register for the stack: MSTKERR, STKERR and STKOF.
const STACKING: u32 = 1 << 4 | 1 << 12 | 1 << 20;

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

/// The handler of hard faults.
///
/// An overflowed stack cannot take another frame, so the stack pointer is reset before any Rust runs.
///
/// # Safety
/// Only the processor may call this, as an exception handler: it discards the stack of the interrupted
/// program, to which nothing returns.
// The name is that of the vector in cortex-m-rt, which expects a handler of this signature.
#[unsafe(export_name = "HardFault")]
#[unsafe(naked)]
unsafe extern "C" fn hard_fault() -> ! {
    naked_asm!("mov r0, sp", "ldr r1, =_stack_start", "mov sp, r1", "b {report}", report = sym report)
}

extern "C" fn report(stack_pointer: u32) -> ! {
    // SAFETY: `SCB::PTR` is the address of the System Control Block on every Cortex-M, and reading CFSR has
    // no side effect.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    let stack = cortex_m_stack::stack();
    let (top, bottom) = (stack.start as u32, stack.end as u32);
    if status & STACKING != 0 || stack_pointer < bottom {
        eprintln!(
            "firmware: stack overflow: the stack has {} bytes, and the stack pointer is at {stack_pointer:#010x}",
            top - bottom
        );
        process::exit(OVERFLOWED)
    }
    eprintln!("firmware: hard fault, status {status:#010x}");
    process::exit(FAULTED)
}
