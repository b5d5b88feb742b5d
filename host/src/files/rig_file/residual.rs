//! The misalignment of a view.

use serde::{Deserialize, Serialize};

/// How far a view is from where it should be, and how it was turned. Deviations are standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residual {
    /// The median shift of matches across the baseline, in pixels: to the right for views in the centre's column, and down
    /// for others.
    pub across_px: f64,
    /// The rotation of the camera since the centre image, about the axes to the right, down and ahead, in degrees.
    pub rotation_deg: [f64; 3],
    /// The deviations of the rotation, in degrees.
    pub rotation_deviation_deg: [f64; 3],
    /// The scale of the image relative to the centre.
    pub scale: f64,
    /// The deviation of the scale.
    pub scale_deviation: f64,
    /// The length of the baseline relative to the mean of all views; 1 if there is only one view.
    pub baseline_scale: f64,
    /// The deviation of that length.
    pub baseline_scale_deviation: f64,
    /// The error that `baseline_scale` causes at the largest disparity of the search, in pixels.
    pub baseline_px: f64,
    /// The angle from where the view should be to where it is, about the optical axis, in degrees; what all views share is
    /// not part of it.
    pub direction_deg: f64,
    /// The deviation of that angle, in degrees.
    pub direction_deviation_deg: f64,
    /// How far the camera was ahead of the plane of the views, in baselines.
    pub ahead: f64,
    /// The deviation of that distance.
    pub ahead_deviation: f64,
    /// The brightness of the view relative to the centre, as a ratio of grey values.
    pub gain: f64,
    /// The number of corners on which the estimate rests.
    pub points: usize,
    /// The median epipolar error of the matches, as Sampson (1982) measures it: how far a corner and its match must move,
    /// together, to be on one epipolar line of an ideal rig, in pixels. It is the distance of the match from the corner across
    /// the baseline over the square root of 2, as each of them moves half of that way.
    pub sampson_px: f64,
    /// The same after rectification.
    pub rectified_sampson_px: f64,
}
