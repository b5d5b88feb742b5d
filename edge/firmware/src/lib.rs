//! Firmware that matches.
//!
//! Each profile of `multiscopic-edge` is a binary of its name. A debugger or an emulator lends it files for
//! frames and packets, a clock and a log, through semihosting. The firmware runs on microcontrollers with Arm or
//! RISC-V processors; elsewhere this library is empty.
//!
//! | module | what it is |
//! | --- | --- |
//! | `runtime` | the entry, the critical section and the stack of the processor, and the end after an error, a panic or a fault |
//! | `semihosted` | the board that a debugger or an emulator lends: files, a clock, marks where phases begin |
//! | `entry_points` | the main functions of the binaries, and of the examples with sweeps |
//!
//! # Features
//! `rp2040`, `stm32f405`, `stm32h743`, `rp2350`, `rp2350-riscv`, `an547`: the board that the firmware is linked for, at most one.
//! Without: the reference board of `memory.x`.
//!
//! `array`: for the profile `qqvga-3x3`, which matches more than four views together.
//!
//! The environment variable `MULTISCOPIC_FUSION` says by which rule the profiles fuse costs: `min`, `mean`, `heuristic`, `half`, or
//! for the network `trimmed`. Without it, by their default, as `multiscopic simulate`.
//!
//! `flash-set`: for the example `qqvga-rectified`, which has its frames in flash.
//!
//! `calibrations`: for the example `calibrate`, whose matches are in a file.
#![no_std]

#[cfg(target_os = "none")]
mod entry_points;
#[cfg(target_os = "none")]
mod runtime;
#[cfg(target_os = "none")]
mod semihosted;

#[cfg(target_os = "none")]
pub use entry_points::{fusion, run, sweep};
#[cfg(target_os = "none")]
pub use runtime::{entry, fail, stack_depth};
#[cfg(target_os = "none")]
pub use semihosted::{HostError, HostFile, Semihosted};

/// The program of a profile's binary.
#[macro_export]
macro_rules! firmware {
    ($profile:path) => {
        #[cfg(target_os = "none")]
        mod image {
            use multiscopic_edge::{Matching, Workspace, workspace};
            use static_cell::ConstStaticCell;

            multiscopic_core::params!(Match: Matching = Ok($profile.matching(multiscopic_firmware::fusion(&$profile))));

            static WORKSPACE: ConstStaticCell<workspace!(Match::PARAMS)> = ConstStaticCell::new(Workspace::new());

            #[multiscopic_firmware::entry]
            fn main() -> ! {
                multiscopic_firmware::run($profile.name, &Match, WORKSPACE.take().pipeline())
            }
        }

        #[cfg(not(target_os = "none"))]
        fn main() -> std::process::ExitCode {
            eprintln!("firmware runs on microcontrollers: `cargo xtask edge` builds it and runs it in the emulator");
            std::process::ExitCode::from(2)
        }
    };
}
