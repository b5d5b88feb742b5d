//! Calibration of lenses, and of their places on the tools of arms, from images of a printed board.
//!
//! The corners of the board are found, and the camera and the poses of the board are sought that explain all of them: first by
//! homographies (Zhang, A flexible new technique for camera calibration, 2000), then by the method of Levenberg and Marquardt
//! over all parameters.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `printed_board` | [`PrintedBoard`]: chessboards and ChArUco boards, and their files to print, as PDF and PNG |
//! | `board_detection` | the corners of a board in an image, found by the crates `calib-targets` and refined below a pixel |
//! | `camera_fit` | the camera and the poses of the board that explain the corners best |
//! | `hand_eye_fit` | the camera on the tool and the board in the base, adjusted together with the poses of an arm that errs |
//! | `hand_eye_calibration` | [`HandEyeCalibration`]: these from pictures of a board and the poses of the tool |
//! | `arm_poses` | [`ArmPose`]: such poses, in files |
//! | `lens_calibration` | [`LensCalibration`]: all of these; [`Coverage`]: where corners are, and what to photograph next |

mod arm_poses;
mod board_detection;
mod camera_fit;
mod hand_eye_calibration;
mod hand_eye_fit;
mod lens_calibration;
mod printed_board;

pub use arm_poses::ArmPose;
pub use board_detection::{BoardCorner, BoardMiss, LEAST_CORNERS};
pub use hand_eye_calibration::{ArmNoise, ArmView, ArmViewErrors, HandEyeCalibration, HandEyeError, LEAST_POSES};
pub use lens_calibration::{BoardImage, BoardReprojection, Coverage, LEAST_IMAGES, LensCalibration, LensCalibrationError};
pub use printed_board::{Paper, PrintedBoard, Rectangle};
