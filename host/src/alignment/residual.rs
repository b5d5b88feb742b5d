//! The misalignment of a view.

use serde::Serialize;

/// How far a view is from where it should be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// The shift of the image across the baseline, in pixels: to the right for views in the
    /// centre's column, and down for others.
    pub across_px: f64,
    /// The length of the baseline relative to the mean of all views; 1 if there is only one view.
    pub baseline_scale: f64,
    /// The error that `baseline_scale` causes at the largest disparity of the search, in pixels.
    pub baseline_px: f64,
    /// The brightness of the view relative to the centre, as a ratio of grey values.
    pub gain: f64,
    /// The number of image blocks on which the estimate rests.
    pub blocks: usize,
}
