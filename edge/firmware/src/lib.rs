//! Firmware that matches.
//!
//! Each profile of `multiscopic-edge` is a binary of its name. A debugger or an emulator lends it files for
//! frames and packets, a clock and a log, through semihosting. The firmware runs on microcontrollers with Arm or
//! RISC-V processors; elsewhere this library is empty.
//!
//! | module | what it is |
//! | --- | --- |
//! | `board_kernel` | the matcher's kernel for the processor of the board |
//! | `runtime` | the entry, the critical section and the stack of the processor, and the end after an error, a panic or a fault |
//! | `semihosted` | the board that a debugger or an emulator lends: files, a clock, marks where phases begin |
//! | `entry_points` | the main functions of the binaries, and their command line |
//!
//! # Features
//! `stm32f405`, `stm32h743`, `rp2350`, `rp2350-riscv`, `an547`: the board that the firmware is linked for, at most one.
//! Without: the reference board of `memory.x`.
//!
//! `array`: for the profile `qqvga-3x3`, which matches more than four views together.
//!
//! `flash-set`: for the example `qqvga-rectified`, which has its frames in flash.
#![no_std]

#[cfg(target_os = "none")]
mod board_kernel;
#[cfg(target_os = "none")]
mod entry_points;
#[cfg(target_os = "none")]
mod runtime;
#[cfg(target_os = "none")]
mod semihosted;

#[cfg(target_os = "none")]
pub use board_kernel::BoardKernel;
#[cfg(target_os = "none")]
pub use entry_points::{
    calibrate, match_around_prior, match_blocks, match_blocks_with_confidences, match_by_network, match_semi_globally,
    match_semi_globally_with_confidences,
};
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
            use multiscopic_core::Fusion;
            use multiscopic_edge::{Matching, Profile, WholeLines, Workspace, workspace};
            use multiscopic_firmware::BoardKernel;
            use static_cell::ConstStaticCell;

            const PROFILE: Profile = $profile;

            static WORKSPACE: ConstStaticCell<workspace!(BoardKernel, PROFILE)> = ConstStaticCell::new(Workspace::new());

            #[multiscopic_firmware::entry]
            fn main() -> ! {
                let pipeline = WORKSPACE.take().pipeline();
                match const { PROFILE.matching(Fusion::Min) } {
                    Matching::Blocks { params, tile_width } => {
                        multiscopic_firmware::match_blocks(PROFILE.name, params, tile_width, pipeline)
                    }
                    Matching::SemiGlobal(params) => multiscopic_firmware::match_semi_globally(PROFILE.name, params, pipeline),
                    Matching::AroundPrior { short, long } => {
                        multiscopic_firmware::match_around_prior(PROFILE.name, (short, long), pipeline)
                    }
                    Matching::WithConfidences(WholeLines::Blocks(params)) => {
                        multiscopic_firmware::match_blocks_with_confidences(PROFILE.name, params, pipeline)
                    }
                    Matching::WithConfidences(WholeLines::SemiGlobal(params)) => {
                        multiscopic_firmware::match_semi_globally_with_confidences(PROFILE.name, params, pipeline)
                    }
                    Matching::Network(params) => multiscopic_firmware::match_by_network(PROFILE.name, params, pipeline),
                }
            }
        }

        #[cfg(not(target_os = "none"))]
        fn main() -> std::process::ExitCode {
            eprintln!("firmware runs on microcontrollers: `cargo xtask edge` builds it and runs it in the emulator");
            std::process::ExitCode::from(2)
        }
    };
}
