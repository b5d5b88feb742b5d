//! How far a match is from its epipolar line.

/// A corner of the centre, and the epipolar error of its match in a view, as Sampson (1982) measures it: see
/// [`Residual::sampson_px`](crate::files::Residual::sampson_px).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarError {
    /// The corner in the centre image, in pixels.
    pub pixel: [f64; 2],
    /// The error in the images, in pixels: above 0 if the match is too far to the right, for views in the centre's column, or too
    /// far down, for others.
    pub before_px: f64,
    /// The same after rectification.
    pub after_px: f64,
}
