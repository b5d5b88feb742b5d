//! The runtime of Arm's microcontrollers.
#![expect(unsafe_code, reason = "a fault handler replaces the stack and reads a register of the processor")]

use core::arch::naked_asm;
use cortex_m::peripheral::SCB; // The crate also provides the critical section.

pub use cortex_m_rt::entry;

use crate::fault;

/// The bits of the Configurable Fault Status Register for the stack: MSTKERR, STKERR and STKOF.
const STACKING: u32 = 1 << 4 | 1 << 12 | 1 << 20;

/// The greatest depth of the stack so far, in bytes. The runtime painted it before the program started.
pub fn stack_depth() -> usize {
    cortex_m_stack::stack_size() as usize - cortex_m_stack::stack_painted() as usize
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
        fault::overflowed(top - bottom, stack_pointer)
    }
    fault::faulted(format_args!("hard fault, status {status:#010x}"))
}
