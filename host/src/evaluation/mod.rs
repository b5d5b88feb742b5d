//! Evaluation: data sets with ground truth, error metrics, and the tables made of them.

mod dataset;
mod metrics;
pub mod record;

pub use dataset::{Dataset, Scene};
pub use metrics::Metrics;
pub use record::{Record, Reduction, Row, Values};
