//! The watchdog of the emulator's board, a CMSDK APB watchdog: it interrupts a program that does not feed it.
#![expect(unsafe_code, reason = "registers are addresses, and an exception has a handler")]

use core::ptr;
use semihosting::{eprintln, process};

/// The exit code of firmware that made no progress.
const STARVED: i32 = 104;

/// The address of the registers of the emulator's board.
const BASE: usize = 0x4000_8000;
const LOAD: *mut u32 = BASE as *mut u32;
const CONTROL: *mut u32 = (BASE + 0x8) as *mut u32;
const CLEAR: *mut u32 = (BASE + 0xc) as *mut u32;
/// Lets it interrupt.
const INTERRUPTS: u32 = 1;

const CLOCK_HZ: u32 = 25_000_000;
const SECONDS: u32 = 5;

/// Starts it.
pub fn start() {
    // SAFETY: the addresses are those of registers of the board, and writing them touches no memory.
    unsafe {
        ptr::write_volatile(LOAD, SECONDS * CLOCK_HZ);
        ptr::write_volatile(CONTROL, INTERRUPTS);
    }
}

/// Tells it that there was progress.
pub fn feed() {
    // SAFETY: as in `start`. Any value restarts the count.
    unsafe { ptr::write_volatile(CLEAR, 1) }
}

/// The handler of the interrupt, which nothing masks.
///
/// # Safety
/// It may interrupt critical sections, so it shares nothing with other code.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() -> ! {
    eprintln!("firmware: the watchdog ended it after {SECONDS} s without progress");
    process::exit(STARVED)
}
