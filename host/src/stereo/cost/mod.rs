//! Matching costs: how much a pixel differs from its match.

pub mod birchfield_tomasi;
pub mod mccnn;
pub mod volume;

pub use volume::{Cost, Volume};
