//! The result of a variant.

use multiscopic::{DisparityMap, Method, stereo::confidence_map::ConfidenceMap};
use multiscopic_core::Search;

use crate::{command::variant::Variant, results::Record};

/// What a variant estimated, and how accurate it is.
pub struct Outcome {
    /// The variant.
    pub variant: Variant,
    /// The method with its parameters.
    pub method: Method,
    /// Where it searched.
    pub search: Search,
    /// The estimate.
    pub disparities: DisparityMap,
    /// How sure it is.
    pub confidences: ConfidenceMap,
    /// The errors.
    pub record: Record,
}
