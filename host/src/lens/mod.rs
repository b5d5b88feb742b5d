//! Lenses: their distortion, the calibration files that describe it, and images without it.
//!
//! An ideal camera maps the direction `(x, y, 1)` to the pixel `(f x + cx, f y + cy)`. The coordinates `x` and `y` are
//! *normalised*: they do not depend on the focal length. A lens distorts them first: to `(x', y')`, by a model with a few
//! coefficients that a calibration finds.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `distortion` | [`Lens`]: the models, from ideal to distorted coordinates and back |
//! | `camera_model` | [`CameraModel`]: a lens, its focal lengths and principal point; [`Mount`]: its rotation on its stage |
//! | `hand_eye` | [`HandEye`]: its place on the tool of an arm |
//! | `measured_views` | [`MeasuredViews`]: how it stood in each view, as the stage measured it |
//! | `calibration_files` | the files of ROS, OpenCV and Kalibr, and `camera.toml` |
//! | `colmap` | photos and their camera from COLMAP's text files |
//! | `undistortion` | [`LensFile`]: a calibration and its file; [`Undistortion`]: pictures as by an ideal camera |

mod calibration_files;
mod camera_model;
mod colmap;
mod distortion;
mod hand_eye;
mod measured_views;
mod undistortion;

pub(crate) use calibration_files::CameraToml;
pub use camera_model::{CameraModel, Mount};
pub use colmap::read_model as read_colmap;
pub use distortion::{Lens, LensError, LensModel};
pub use hand_eye::HandEye;
pub use measured_views::MeasuredViews;
pub use undistortion::{LensFile, Undistortion};
