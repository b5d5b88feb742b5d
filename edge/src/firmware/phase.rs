//! Where the phases of the work begin, for a debugger's breakpoint or an emulator that counts.
#![expect(unsafe_code, reason = "the functions are found by their names, and must not be the same")]

use core::arch::asm;

use crate::Phase;

/// Passes the beginning of `phase`.
#[inline(always)]
pub fn enter(phase: Phase) {
    match phase {
        Phase::Idle => phase_idle(),
        Phase::Matching => phase_matching(),
        Phase::Fetching => phase_fetching(),
        Phase::Sending => phase_sending(),
    }
}

macro_rules! mark {
    ($name:ident, $number:literal) => {
        #[unsafe(no_mangle)]
        #[inline(never)]
        extern "C" fn $name() {
            // SAFETY: it writes a register that it says it writes. Functions that do nothing would become one.
            unsafe { asm!("movs {}, {}", out(reg) _, const $number) }
        }
    };
}

mark!(phase_idle, 0);
mark!(phase_matching, 1);
mark!(phase_fetching, 2);
mark!(phase_sending, 3);
