//! Multiscopic matching on a microcontroller: scanlines in, packets of disparities out.
//!
//! The crate is portable. Firmware implements [`Board`] for its hardware and lends the [`Pipeline`] its
//! memory; a host simulates the same pipeline, byte for byte, and decodes the packets. Data flows down this
//! table, and no module uses one below it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `board` | what the pipeline asks of a board |
//! | `streams` | scanlines from byte streams |
//! | [`frame_file`] | the names of the files of frames and packets |
//! | [`packet`] | the packets that carry disparities to a host |
//! | `buffers` | the memory of the pipeline, sized at compile time |
//! | `matching` | what a pipeline computes: [`Matching`] |
//! | [`profile`] | ready-made match sizes and their RAM budgets |
//! | `pipeline` | matches the frames of a board and sends the disparities |
#![no_std]

mod board;
mod buffers;
pub mod frame_file;
mod matching;
pub mod packet;
mod pipeline;
pub mod profile;
mod streams;

pub use board::{Board, Phase};
pub use buffers::{Lengths, Wide, Workspace};
pub use matching::{Matching, WholeLines};
pub use pipeline::{Pipeline, PipelineError, RunError};
pub use profile::Profile;
pub use streams::{Streams, StreamsError};
