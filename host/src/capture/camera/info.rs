//! Cameras, as they are listed.

use std::path::PathBuf;

use serde::Serialize;

/// A camera, with its formats and sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Its device file.
    pub device: PathBuf,
    /// Its name; empty if it cannot be opened.
    pub card: String,
    /// Its driver; empty if it cannot be opened.
    pub driver: String,
    /// The bus and port that it is connected to; empty if it cannot be opened.
    pub bus: String,
    /// Why it cannot be used.
    pub problem: Option<String>,
    /// The formats that it has.
    pub formats: Vec<FormatInfo>,
}

/// A pixel format of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatInfo {
    /// Its four-character code, without padding.
    pub format: String,
    /// The driver's description.
    pub description: String,
    /// Whether it is a [`PixelFormat`](super::PixelFormat).
    pub is_supported: bool,
    /// The frame sizes that it comes in.
    pub sizes: Vec<FrameSizes>,
}

/// Frame sizes: width and height in pixels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum FrameSizes {
    /// A single size.
    One([u32; 2]),
    /// A range of sizes.
    Range {
        /// The smallest size.
        min: [u32; 2],
        /// The largest size.
        max: [u32; 2],
        /// The increments from the smallest size.
        step: [u32; 2],
    },
}
