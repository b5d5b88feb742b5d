//! Firmware that matches: what it matches, the lines it reads, and the packets it sends.
//!
//! Each profile is a binary of its name. The parts that need a processor, in `firmware`, are there for Arm alone; the
//! others run and are tested anywhere. Firmware for a board of one's own implements [`Board`], and takes this library without its
//! default features.
//!
//! # Features
//! - `semihosting` (default): the firmware of the profiles, whose files and log a debugger or an emulator lends, with its handlers of
//!   panics and faults.
//! - `stepper` (default): a stage that stepping motors move, over the pins of any HAL.
//! - `hm01b0` (default): a camera with the sensor HM01B0, over any HAL's I2C bus.
//! - `stm32f405`, `stm32h743`, `an547`: the board that it is linked for, at most one; without, the reference board of `memory.x`.
#![no_std]

mod board;
#[cfg(all(target_os = "none", feature = "semihosting"))]
pub mod firmware;
pub mod frame_file;
#[cfg(feature = "hm01b0")]
pub mod hm01b0;
mod kernel;
pub mod packet;
mod pipeline;
pub mod profile;
#[cfg(feature = "stepper")]
pub mod stepper;
mod streams;

pub use board::{Board, Phase};
pub use kernel::{Kernel, Wide};
pub use pipeline::{Lengths, Pipeline, PipelineError, RunError, Workspace};
pub use profile::Profile;
pub use streams::{Streams, StreamsError};

/// The type of the [`Workspace`] that a kernel needs for a profile.
#[macro_export]
macro_rules! workspace {
    ($kernel:ty, $profile:path) => {
        $crate::Workspace<
            { $profile.lengths::<$kernel>().matcher.words() },
            { $profile.lengths::<$kernel>().columns },
            { $profile.lengths::<$kernel>().packet },
        >
    };
}

/// The program of a profile's binary.
#[macro_export]
macro_rules! firmware {
    ($profile:path) => {
        #[cfg(target_os = "none")]
        mod image {
            use multiscopic_edge::{Kernel, Profile, Workspace, firmware, workspace};
            use static_cell::ConstStaticCell;

            const PROFILE: Profile = $profile;

            static WORKSPACE: ConstStaticCell<workspace!(Kernel, PROFILE)> = ConstStaticCell::new(Workspace::new());

            #[cortex_m_rt::entry]
            fn main() -> ! {
                firmware::run(&PROFILE, WORKSPACE.take().pipeline())
            }
        }

        /// Firmware runs on Arm; here it can only say so.
        #[cfg(not(target_os = "none"))]
        fn main() -> std::process::ExitCode {
            eprintln!("firmware runs on Arm: `cargo xtask edge` builds it and runs it in the emulator");
            std::process::ExitCode::from(2)
        }
    };
}
