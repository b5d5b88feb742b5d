//! Matching cost: how much a pixel differs from its match, fused over the views.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

pub mod birchfield_tomasi;
pub mod census;
mod cost_rows;
pub mod matches;
pub mod mccnn;
pub mod volume;

pub use birchfield_tomasi::BirchfieldTomasi;
pub use census::Census;
pub use cost_rows::{Cost, CostRows};
pub use volume::Volume;
