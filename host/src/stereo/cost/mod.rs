//! Matching cost: how much a pixel differs from its match, fused over the views.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

pub mod birchfield_tomasi;
mod block_rows;
mod census_image;
mod census_pair_rows;
mod census_rows;
mod census_sampling;
mod cost_rows;
mod fused_cost;
pub mod matches;
pub mod mccnn;
mod sad;
pub mod volume;

pub use birchfield_tomasi::BirchfieldTomasi;
pub use block_rows::BlockRows;
pub use census_pair_rows::CensusPairRows;
pub use census_rows::CensusRows;
pub use cost_rows::{Cost, CostRows};
pub use fused_cost::fused_cost;
pub use sad::SadRows;
pub use volume::Volume;
