//! Marks where phases begin, for breakpoints of a debugger or an emulator that counts.
#![expect(unsafe_code, reason = "the functions need names for the linker, and bodies that differ")]

use core::arch::asm;
use multiscopic_edge::Phase;

/// Calls the marker of `phase`.
#[inline(always)]
pub fn mark(phase: Phase) {
    match phase {
        Phase::Idle => phase_idle(),
        Phase::Matching => phase_matching(),
        Phase::Fetching => phase_fetching(),
        Phase::Sending => phase_sending(),
    }
}

/// The instruction that writes a number to a register.
#[cfg(target_arch = "arm")]
macro_rules! copy {
    () => {
        "movs"
    };
}
#[cfg(target_arch = "riscv32")]
macro_rules! copy {
    () => {
        "li"
    };
}

macro_rules! marker {
    ($name:ident, $number:literal) => {
        // Exported under its name, which no other symbol of the image has.
        #[unsafe(no_mangle)]
        #[inline(never)]
        extern "C" fn $name() {
            // SAFETY: the instruction writes the register that it declares, and the flags, which `asm!` takes
            // as clobbered. Bodies without it would be the same, and could be folded into one function.
            unsafe { asm!(concat!(copy!(), " {}, {}"), out(reg) _, const $number) }
        }
    };
}

marker!(phase_idle, 0);
marker!(phase_matching, 1);
marker!(phase_fetching, 2);
marker!(phase_sending, 3);
