//! Accurate depth from one camera moved on purpose, on the host: files, matching with threads, evaluation and pictures.

pub mod budget;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub mod camera;
pub mod cost;
pub mod dataset;
pub mod depth;
pub mod disparity_map;
pub mod error;
pub mod error_map;
pub mod evaluation;
pub mod frames;
pub mod geometry;
pub mod image_file;
mod input;
pub mod matching;
pub mod measured;
pub mod metrics;
pub mod montage;
pub mod output;
pub mod pfm;
pub mod picture;
pub mod ply;
pub mod processor;
pub mod raster;
pub mod reception;
pub mod report;
pub mod rig;
pub mod scene;
pub mod simd;
pub mod simulation;
pub mod turbo;

pub use dataset::Dataset;
pub use disparity_map::DisparityMap;
pub use error::{Error, Result};
pub use frames::Frames;
pub use geometry::Geometry;
pub use matching::Engine;
pub use metrics::Metrics;
pub use pfm::FloatImage;
pub use picture::Picture;
pub use processor::Processor;
pub use raster::Raster;
pub use rig::Rig;
pub use simd::Simd;
