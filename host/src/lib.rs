//! Accurate depth from one camera moved on purpose, on the host: files, matching with threads, evaluation and pictures.

pub mod error;

pub use error::{Error, Result};
