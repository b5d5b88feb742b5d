//! How good a rig is, in the units of depth cameras: errors of depth, walls, and noise over repeated captures.

mod depth_errors;
mod plane_fit;
mod temporal_noise;
mod wall_metrics;

pub use depth_errors::DepthErrors;
pub use plane_fit::PlaneFit;
pub use temporal_noise::TemporalNoise;
pub use wall_metrics::{WallMetrics, WallPlace};
