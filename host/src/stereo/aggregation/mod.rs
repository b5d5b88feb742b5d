//! Aggregation: costs are averaged over a support region around each pixel.
//!
//! The block of [`Sad`](super::CostFunction::Sad) costs is aggregation too; the core sums it together with
//! the cost.

mod cross_based;

pub use cross_based::{Aggregation, CrossBased, SupportRegion};
