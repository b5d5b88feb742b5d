//! Optimization: the disparity of every pixel by its costs, and by those of its neighbours.

pub mod edge_aware;
pub mod graph_cuts;

pub use multiscopic_engine::{sgm, winner};
