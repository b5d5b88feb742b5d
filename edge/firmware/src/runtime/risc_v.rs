//! The runtime of RISC-V microcontrollers.
#![expect(unsafe_code, reason = "a trap handler replaces the stack, and the stack is painted and looked at")]

use core::{arch::asm, arch::global_asm, ptr};
use riscv as _; // Provides the critical section.

pub use riscv_rt::entry;

use crate::fault;

/// The word that the stack is painted with.
const PAINT: u32 = 0xccca_cacc;

unsafe extern "C" {
    // Symbols of the linker script: their addresses are the ends of the stack.
    static mut _stack_start: u32;
    static mut _stack_end: u32;
}

/// The greatest depth of the stack so far, in bytes.
pub fn stack_depth() -> usize {
    let (top, mut word) = (&raw const _stack_start, &raw const _stack_end);
    // SAFETY: the words between the ends of the stack are memory that nothing else writes meanwhile.
    while word < top && unsafe { word.read_volatile() } == PAINT {
        word = word.wrapping_add(1);
    }
    top as usize - word as usize
}

/// Paints the stack below the running function.
#[riscv_rt::post_init]
fn paint(_hart: usize) {
    let (pointer, mut word): (*const u32, _) = {
        let pointer: usize;
        // SAFETY: the instruction copies a register.
        unsafe { asm!("mv {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags)) };
        (ptr::without_provenance(pointer), &raw mut _stack_end)
    };
    while word.cast_const() < pointer {
        // SAFETY: below the stack pointer, the stack is not in use.
        unsafe { word.write_volatile(PAINT) };
        word = word.wrapping_add(1);
    }
}

// The handler of exceptions, in place of riscv-rt's. An overflowed stack cannot take another frame, so the stack pointer is reset
// before any Rust runs. Nothing returns to the interrupted program, and there are no interrupts.
global_asm!(
    ".section .trap.start, \"ax\"",
    ".balign 4",
    ".global _start_trap",
    "_start_trap:",
    "mv a0, sp",
    "csrr a1, mcause",
    "csrr a2, mepc",
    "la sp, _stack_start",
    "tail {report}",
    report = sym report,
);

extern "C" fn report(stack_pointer: u32, cause: u32, address: u32) -> ! {
    let (top, bottom) = ((&raw const _stack_start) as u32, (&raw const _stack_end) as u32);
    if stack_pointer < bottom {
        fault::overflowed(top - bottom, stack_pointer)
    }
    fault::faulted(format_args!("exception {cause} at {address:#010x}"))
}
