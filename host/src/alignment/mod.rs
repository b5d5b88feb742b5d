//! Rectification: how far each view of a capture is from where it should be, estimated from the images alone, and taken out.
//!
//! A camera that is moved by hand or by a cheap slide, or is not square to the slide, gives views that are turned against
//! each other, lie off the baseline, and differ in scale, in brightness and in the lengths of their baselines. Matching
//! searches along the baseline only, and compares grey values, so it suffers from all of these.
//!
//! Corners of the centre are found in each view, those that disagree with the others are dropped, and a bundle adjustment
//! gives each view a rotation, a scale, a shift and a position, as far as the images prove them, and each corner a disparity. The camera turns with the stage's axes
//! in all views alike: one common rotation makes the positions stand along the image's rows and columns. The frames are then
//! resampled as if the camera had not been turned at all.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `tracking` | corners of the centre, found in a view by images at descending sizes, and the matches that agree |
//! | `view_geometry` | the rotation of each view and that of all, the errors of matches: [`EpipolarError`], and homographies |
//! | `adjustment` | bundle adjustment |
//! | `selection` | the parameters that the images prove, within a [`Tolerance`] if the rig is calibrated, and how certain they are |
//! | `mounting` | the rotation of a camera against the stage that moves it: [`Mounting`] |
//! | `inspection` | the properties of images before they are matched: [`Inspection`] |
//! | `delay` | the delay between a camera that runs free and its stage: [`Delay`] |
//! | `estimate` | all of these for a capture: [`Alignment`] |

mod adjustment;
mod delay;
mod estimate;
mod inspection;
mod mounting;
mod selection;
mod tracking;
mod view_geometry;

pub use delay::{Delay, Way};
pub use estimate::Alignment;
pub use inspection::Inspection;
pub use mounting::Mounting;
pub use selection::Tolerance;
pub use view_geometry::{EpipolarError, across};
