//! Fused matching costs: how much a pixel differs from its match.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

mod census_image;
mod census_pair_rows;
mod census_rows;
mod census_sampling;
mod cost_rows;
mod matches;
mod sad;
mod volume;

pub use census_pair_rows::CensusPairRows;
pub use census_rows::CensusRows;
pub use cost_rows::{Cost, CostRows};
pub use matches::RowMatches;
pub use sad::SadRows;
pub use volume::Volume;
