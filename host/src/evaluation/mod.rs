//! Evaluation: data sets with ground truth, error metrics, and the quality of a rig in the units of depth cameras: errors of
//! depth, walls, and noise over repeated captures.

mod dataset;
mod dataset_scene;
mod depth_errors;
mod metrics;
mod wall_metrics;

pub use dataset::{CameraSteps, Dataset};
pub use dataset_scene::DatasetScene;
pub use depth_errors::{DepthErrors, TemporalNoise};
pub use metrics::{ConfidenceMetrics, LightFieldMetrics, Metrics, Sparsification};
pub use wall_metrics::{PlaneFit, WallMetrics, WallPlace};
