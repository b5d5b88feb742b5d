//! The processor's runtime: the entry, the critical section, how deep the stack was, and the end of the firmware after an
//! error, a panic or a fault, with a message and an exit code.
//!
//! After a panic or a fault the log may be broken, so these messages are plain text.

#[cfg(target_arch = "arm")]
pub use cortex_m::{entry, stack_depth};
#[cfg(target_arch = "riscv32")]
pub use risc_v::{entry, stack_depth};

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

/// Ends the firmware after a fault in which the stack pointer was beyond the stack of `bytes` bytes.
fn overflowed(bytes: u32, stack_pointer: u32) -> ! {
    eprintln!("firmware: stack overflow: the stack has {bytes} bytes, and the stack pointer is at {stack_pointer:#010x}");
    process::exit(OVERFLOWED)
}

/// Ends the firmware after another fault.
fn faulted(fault: Arguments<'_>) -> ! {
    eprintln!("firmware: {fault}");
    process::exit(FAULTED)
}

/// The runtime of Arm's microcontrollers.
#[cfg(target_arch = "arm")]
mod cortex_m {
    #![expect(unsafe_code, reason = "a fault handler replaces the stack and reads a register of the processor")]

    use core::{arch::naked_asm, ptr};
    use cortex_m as _; // Provides the critical section.

    pub use cortex_m_rt::entry;

    use super::{faulted, overflowed};

    /// The Configurable Fault Status Register. A Cortex-M0+ has none, and reads 0 there.
    const CFSR: *const u32 = ptr::without_provenance(0xe000_ed28);
    /// Its bits for the stack: MSTKERR, STKERR and STKOF.
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
        naked_asm!("mov r0, sp", "ldr r1, =_stack_start", "mov sp, r1", "bl {report}", report = sym report)
    }

    extern "C" fn report(stack_pointer: u32) -> ! {
        // SAFETY: the address belongs to the System Control Block of every Cortex-M, and reading it has no side effect.
        let status = unsafe { CFSR.read_volatile() };
        let stack = cortex_m_stack::stack();
        let (top, bottom) = (stack.start as u32, stack.end as u32);
        if status & STACKING != 0 || stack_pointer < bottom {
            overflowed(top - bottom, stack_pointer)
        }
        faulted(format_args!("hard fault, status {status:#010x}"))
    }
}

/// The runtime of RISC-V microcontrollers.
#[cfg(target_arch = "riscv32")]
mod risc_v {
    #![expect(unsafe_code, reason = "a trap handler replaces the stack, and the stack is painted and looked at")]

    use core::{arch::asm, arch::global_asm, ptr};
    use riscv as _; // Provides the critical section.

    pub use riscv_rt::entry;

    use super::{faulted, overflowed};

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

    // The handler of exceptions, in place of riscv-rt's. An overflowed stack cannot take another frame, so the stack pointer is
    // reset before any Rust runs. Nothing returns to the interrupted program, and there are no interrupts.
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
            overflowed(top - bottom, stack_pointer)
        }
        faulted(format_args!("exception {cause} at {address:#010x}"))
    }
}
