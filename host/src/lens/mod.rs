//! Lenses: their distortion, the calibration files that describe it, and images without it.
//!
//! An ideal camera maps the direction `(x, y, 1)` to the pixel `(f x + cx, f y + cy)`. The coordinates `x` and `y` are
//! *normalised*: they do not depend on the focal length. A lens distorts them first: to `(x', y')`, by a model with a few
//! coefficients that a calibration finds.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `distortion` | [`Lens`]: the models, from ideal to distorted coordinates and back |
//! | `camera_model` | [`CameraModel`]: a lens, the focal lengths and the principal point, from pixels to directions and back |
//! | `lens_file` | [`LensFile`]: a calibration and the file that it is from |
//! | `calibration_files` | the files of ROS, OpenCV and Kalibr, and `camera.toml` |
//! | `mount` | [`Mount`]: the rotation of a camera against its stage |
//! | `undistortion` | [`Undistortion`]: pictures as an ideal camera, square to its stage, would have taken them |

mod calibration_files;
mod camera_model;
mod distortion;
mod lens_file;
mod mount;
mod undistortion;

pub(crate) use calibration_files::CameraToml;
pub use camera_model::CameraModel;
pub use distortion::{Lens, LensError, LensModel};
pub use lens_file::LensFile;
pub use mount::Mount;
pub use undistortion::Undistortion;
