//! The reasons why pictures do not determine what is asked of them.

use multiscopic_core::View;

/// The reason why views cannot be aligned.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AlignmentError {
    /// Too few corners of the centre are found in a view.
    #[error("the {view} view has {count} textured blocks in common with the centre, and alignment needs {needed}: {hint}")]
    FewBlocks {
        /// The view.
        view: View,
        /// The number of corners that are found.
        count: usize,
        /// The number that alignment needs.
        needed: usize,
        /// The probable cause, and what to do.
        hint: &'static str,
    },
    /// The matches fit any positions of the views.
    #[error("the images do not determine how the views are aligned")]
    Undetermined,
}

/// The reason why frames do not determine how a camera is mounted, or the focal length.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MountingError {
    /// Too few corners of the centre are found again in a view.
    #[error(
        "after the move to the {view} view, {count} textured blocks are found again, and {needed} are needed: let the camera see a \
         scene with texture everywhere, take a shorter step, and check that the stage moves in the image plane"
    )]
    FewBlocks {
        /// The view.
        view: View,
        /// The number of corners that are found again.
        count: usize,
        /// The number that is needed.
        needed: usize,
    },
    /// The scene moves along with the camera.
    #[error(
        "after the move to the {view} view, the scene has moved along with the camera: the stage moved the other way; reverse its axis, \
         or turn the camera"
    )]
    Reversed {
        /// The view.
        view: View,
    },
    /// The images fit any motion.
    #[error("the images do not determine how the camera moved")]
    Undetermined,
    /// The longest moves shift the scene too little.
    #[error(
        "the longest moves shift the scene by {parallax_px:.1} pixels, and {needed_px} are needed: take a longer step, or a nearer \
         scene"
    )]
    SmallParallax {
        /// The median parallax of the longest moves, in pixels.
        parallax_px: f64,
        /// The parallax that is needed, in pixels.
        needed_px: f64,
    },
    /// The angles between the camera and its stage are not certain enough.
    #[error(
        "the angles between camera and stage are uncertain by {deviation_deg:.2} degrees, and {allowed_deg} are allowed: take a \
         longer step, a nearer scene with texture up to the borders of the image, or a stage that repeats its moves better"
    )]
    Uncertain {
        /// The largest standard deviation of an angle, in degrees.
        deviation_deg: f64,
        /// The largest that is allowed, in degrees.
        allowed_deg: f64,
    },
    /// The middle of the image shows no flat target.
    #[error(
        "the distance is that of a flat target in the middle of the image, but {count} points there are at distances that differ by \
         {:.0} %: put a textured board there, or give the focal length or the lens instead",
        100.0 * spread
    )]
    NoFlatTarget {
        /// The number of points in the middle of the image.
        count: usize,
        /// The share by which their distances differ.
        spread: f64,
    },
}

/// The reason why disparities determine no plane, or none that can be a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlaneError {
    /// There are too few pixels.
    #[error("only {count} pixels have a disparity, a plane takes at least {needed}")]
    TooFew {
        /// The number of pixels.
        count: usize,
        /// The number that a plane takes at least.
        needed: usize,
    },
    /// The pixels determine a line alone.
    #[error("all pixels that have a disparity are on a line, which determines no plane")]
    OnALine,
    /// The plane is behind the camera, or parallel to its optical axis.
    #[error("the plane that fits best does not meet the optical axis before the camera")]
    Behind,
}
