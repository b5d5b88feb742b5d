//! The result of a variant.

use multiscopic::{DisparityMap, evaluation::Record};

/// What a variant estimated, and how accurate it is.
pub struct Outcome {
    /// The stem of the variant's files.
    pub stem: String,
    /// The estimate.
    pub disparities: DisparityMap,
    /// The errors.
    pub record: Record,
}
