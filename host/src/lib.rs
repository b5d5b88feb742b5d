//! Accurate depth from one camera moved on purpose, on the host: files, matching with threads, evaluation and pictures.

pub mod error;
mod image_file;
mod input;
pub mod output;
pub mod pfm;
pub mod picture;
pub mod raster;

pub use error::{Error, Result};
pub use pfm::FloatImage;
pub use picture::Picture;
pub use raster::Raster;
