//! Files: pictures and maps read and written, whole or not at all.

pub mod codec;
mod disparity_files;
mod frame_files;
pub(crate) mod input;
pub mod output;
pub mod pfm;
mod picture_files;
pub mod ply;
mod rig;

pub use frame_files::Images;
pub use rig::{Provenance, Rig};
