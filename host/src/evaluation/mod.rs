//! Evaluation: data sets with ground truth, error metrics, and the table of results.

mod camera_steps;
mod dataset;
mod dataset_scene;
mod ground_truth;
mod metrics;
mod record;
mod result_row;
pub mod results;

pub use camera_steps::CameraSteps;
pub use dataset::Dataset;
pub use dataset_scene::DatasetScene;
pub use metrics::Metrics;
pub use record::{Record, Reduction};
pub use result_row::{ResultRow, RowValues};
