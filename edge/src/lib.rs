//! The parts of the firmware that do not depend on a processor: what it matches, the lines it reads, and those it writes.
//!
//! The firmware itself is the binary `firmware`; it builds for Arm.
#![no_std]

pub mod files;
mod pipeline;
pub mod profile;
mod streams;

pub use pipeline::{PipelineError, Workspace};
pub use profile::Profile;
pub use streams::{Streams, StreamsError};
