//! The quality of a rig, in the units of depth cameras: errors of depth, walls, and noise over repeated captures.

mod depth_errors;
mod wall_metrics;

pub use depth_errors::{DepthErrors, TemporalNoise};
pub use wall_metrics::{PlaneFit, WallMetrics, WallPlace};
