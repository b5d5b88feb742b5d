//! Reading and writing files: pictures, frames, disparity maps, point clouds and rigs. An output is complete,
//! or it is not there.

mod cloud;
pub(crate) mod decoded;
mod disparity_files;
mod exif;
mod file_kind;
mod frame_files;
pub mod image_codec;
pub mod input;
mod jpeg_scans;
mod netpbm;
pub(crate) mod npy;
pub mod output;
mod pair_calibration;
mod pfm;
mod photo_poses;
mod picture_files;
pub mod ply;
mod rig_file;
mod rig_list;
#[cfg(feature = "mcap")]
pub mod ros;
mod tiff_files;
mod utc;

pub use cloud::{Cloud, CloudPoint};
pub use disparity_files::{
    CornerDisparities, DisparityEncoding, MatchedImages, StoredDisparities, read_disparities, write_depth_mm, write_raw16,
};
pub use exif::{ExifFocal, exif_focal};
pub use frame_files::FrameFiles;
pub use input::Limits;
pub use npy::{write_npy, write_npz};
pub use pair_calibration::PairCalibration;
pub use pfm::{pfm_bytes, read_pfm, read_pfm_within, write_pfm};
pub use photo_poses::{PhotoGrid, PhotoLine, PosedPhoto};
pub use rig_file::{AlignmentRecord, FramePose, Provenance, Residual, Rig, SweepFrame};
pub use rig_list::ListedRig;
