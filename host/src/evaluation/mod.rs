//! Evaluation: data sets with ground truth, error metrics, planes and repeated captures.

mod dataset;
mod dataset_scene;
mod depth_quality;
pub mod ground_truth;
mod metrics;
mod sparsification;

pub use dataset::{CameraSteps, Dataset};
pub use dataset_scene::DatasetScene;
pub use depth_quality::{DepthErrors, PlaneFit, TemporalNoise, WallMetrics, WallPlace};
pub use metrics::Metrics;
pub use sparsification::{ConfidenceMetrics, Sparsification};
