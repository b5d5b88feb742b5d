//! Aggregation: costs are summed over the support region of a pixel.

pub mod cross_based;
