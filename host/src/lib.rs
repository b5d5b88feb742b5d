//! Accurate depth from one camera moved on purpose, on the host: files, matching with threads, evaluation and pictures.

pub mod error;
mod input;
pub mod output;
pub mod raster;

pub use error::{Error, Result};
pub use raster::Raster;
