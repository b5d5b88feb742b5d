//! The interrupts that the executors run in. No hardware raises them.
#![allow(unsafe_code)]

use embassy_rp::{executor::InterruptExecutor, interrupt};

/// Receives lines.
pub static CAMERA: InterruptExecutor = InterruptExecutor::new();
/// Sends packets.
pub static USB: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
unsafe fn SWI_IRQ_1() {
    // SAFETY: `main` starts the executor with this interrupt, which enables it.
    unsafe { CAMERA.on_interrupt() }
}

#[interrupt]
unsafe fn SWI_IRQ_0() {
    // SAFETY: as above.
    unsafe { USB.on_interrupt() }
}
