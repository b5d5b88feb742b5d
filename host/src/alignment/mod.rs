//! Rectification: how far each view of a capture is from where it should be, estimated from the images alone, and taken out.
//!
//! A camera that is moved by hand or by a cheap slide, or is not square to the slide, gives views that are turned against
//! each other, lie off the baseline, and differ in scale, in brightness and in the lengths of their baselines. Matching
//! searches along the baseline only, and compares grey values, so it suffers from all of these.
//!
//! Corners of the centre are found in each view, those that disagree with the others are dropped, and a bundle adjustment
//! gives each view a rotation, a scale and a position, and each corner a disparity. The camera turns with the stage's axes
//! in all views alike: one common rotation makes the positions stand along the image's rows and columns. The frames are then
//! resampled as if the camera had not been turned at all.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `tracking` | corners of the centre, found in a view by images at descending sizes, and the matches that agree with each other |
//! | `view_model` | the places and the rotations of views, the errors of their matches: [`EpipolarError`] |
//! | `adjustment` | bundle adjustment |
//! | `homography` | the common rotation, and the homographies of the frames |
//! | `mounting` | the rotation of a camera against the stage that moves it: [`Mounting`] |
//! | `inspection` | the properties of images before they are matched: [`Inspection`] |
//! | `estimate` | all of these for a capture: [`Alignment`] |

mod adjustment;
mod estimate;
mod homography;
mod inspection;
mod mounting;
mod tracking;
mod view_model;

pub use estimate::Alignment;
pub(crate) use estimate::median;
pub use inspection::Inspection;
pub use mounting::Mounting;
pub use view_model::{EpipolarError, across};
