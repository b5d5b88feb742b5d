//! Matching cost: the difference between a pixel and its match, fused over the views.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

pub mod birchfield_tomasi;
mod block_rows;
mod fused_cost;
pub mod mccnn;

pub use multiscopic_engine::cost::{CensusPairRows, CensusRows, Cost, CostRows, RowMatches, SadRows, Volume};

pub use birchfield_tomasi::BirchfieldTomasi;
pub use block_rows::BlockRows;
pub use fused_cost::{fuse, fused_cost};
