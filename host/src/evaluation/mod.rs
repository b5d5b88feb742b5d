//! Evaluation: data sets with ground truth, error metrics, planes and repeated captures, and the tables of results.

mod camera_steps;
mod dataset;
mod dataset_scene;
mod depth_quality;
pub mod ground_truth;
mod metrics;
mod record;
mod result_row;
pub mod results;
mod sparsification;
mod text_table;

pub use camera_steps::CameraSteps;
pub use dataset::Dataset;
pub use dataset_scene::DatasetScene;
pub use depth_quality::{DepthErrors, PlaneFit, TemporalNoise, WallMetrics, WallPlace};
pub use metrics::Metrics;
pub use record::{Record, Reduction};
pub use result_row::{ResultRow, RowValues};
pub use sparsification::{ConfidenceMetrics, Sparsification};
pub use text_table::text_table;
