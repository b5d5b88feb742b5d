//! Optimization: from costs to the disparity of every pixel.

pub mod edge_aware;
pub mod graph_cuts;
pub mod sgm;
