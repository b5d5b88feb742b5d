//! The result of a variant.

use multiscopic::{DisparityMap, evaluation::Record};

use crate::command::variant::Variant;

/// What a variant estimated, and how accurate it is.
pub struct Outcome {
    /// The variant.
    pub variant: Variant,
    /// The estimate.
    pub disparities: DisparityMap,
    /// The errors.
    pub record: Record,
}
