//! Runs the example of the README, with the scene of `edge/start`, and marks the phases that its instructions are counted by.
#![no_std]
#![no_main]

mod example;

use core::{arch::asm, convert::Infallible};
use multiscopic_core::{Frame, ScanlineSource};
use semihosting::process;

/// The scene. Reading it is a phase of its own.
struct Camera;

impl ScanlineSource for Camera {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        phase_fetching();
        let read = start::Camera.read_line(frame, v, line);
        phase_matching();
        read
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    phase_matching();
    example::run(&mut Camera, |v, line| {
        phase_sending();
        if let Ok(line) = line.try_into() {
            start::print_line(v, line);
        }
        phase_matching();
    });
    phase_idle();
    process::exit(0)
}

macro_rules! marker {
    ($name:ident, $number:literal) => {
        #[inline(never)]
        #[unsafe(no_mangle)]
        extern "C" fn $name() {
            // SAFETY: changes a register that it says it changes. The number keeps functions apart that would be merged.
            unsafe { asm!(concat!("movs {0}, #", $number), out(reg) _, options(nomem, nostack)) }
        }
    };
}

marker!(phase_idle, 0);
marker!(phase_matching, 1);
marker!(phase_fetching, 2);
marker!(phase_sending, 3);
