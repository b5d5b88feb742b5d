//! The result of a variant.

use multiscopic::{DisparityMap, Method, evaluation::Record, stereo::confidence_map::ConfidenceMap};
use multiscopic_core::Search;

use crate::command::variant::Variant;

/// The estimates of a variant, and their accuracy.
pub struct Outcome {
    /// The variant.
    pub variant: Variant,
    /// The method with its parameters.
    pub method: Method,
    /// The range that it searched.
    pub search: Search,
    /// The estimate.
    pub disparities: DisparityMap,
    /// Its confidences.
    pub confidences: ConfidenceMap,
    /// The errors.
    pub record: Record,
}
