//! Firmware that matches: what it matches, the lines it reads, and the packets it sends.
//!
//! Each profile is a binary of its name. The parts that need a processor, in `firmware`, are there for Arm alone; the
//! others run and are tested anywhere.
#![no_std]

mod board;
#[cfg(target_os = "none")]
pub mod firmware;
pub mod frame_file;
mod kernel;
pub mod packet;
mod pipeline;
pub mod profile;
mod streams;

pub use board::{Board, Phase};
pub use kernel::Kernel;
pub use pipeline::{Pipeline, PipelineError, Workspace};
pub use profile::Profile;
pub use streams::{Streams, StreamsError};

/// The program of a profile's binary.
#[macro_export]
macro_rules! firmware {
    ($profile:path) => {
        #[cfg(target_os = "none")]
        mod image {
            use multiscopic_edge::{Profile, Workspace, firmware};
            use static_cell::ConstStaticCell;

            const PROFILE: Profile = $profile;
            const WORDS: usize = PROFILE.memory_words();
            const COLUMNS: usize = PROFILE.tile_width();
            const PACKET: usize = PROFILE.packet_bytes();

            static WORKSPACE: ConstStaticCell<Workspace<WORDS, COLUMNS, PACKET>> = ConstStaticCell::new(Workspace::new());

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
