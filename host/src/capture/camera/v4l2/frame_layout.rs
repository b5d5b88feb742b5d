//! The layout of a camera's frames in memory.

use std::fmt;

use crate::capture::camera::settings::PixelFormat;

/// The layout of a camera's frames in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLayout {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Bytes from the start of a row to the start of the next; 0 if rows are not padded. JPEG images have no
    /// stride.
    pub stride: u32,
}

impl FrameLayout {
    /// The fewest bytes that a frame can have: its last row need not be padded.
    pub(super) fn bytes(&self) -> u64 {
        let [width, height] = self.size.map(u64::from);
        let stride = self.stride() as u64;
        // A driver may claim any size. No buffer has as many bytes as the greatest number.
        let luma = height.saturating_sub(1).saturating_mul(stride);
        match self.format {
            // One row of chroma for every two of luma.
            PixelFormat::Nv12 => {
                let chroma = height.div_ceil(2).saturating_mul(stride);
                luma.saturating_add(chroma).saturating_add(2 * width.div_ceil(2))
            }
            _ => luma.saturating_add(self.row_bytes() as u64),
        }
    }

    /// Bytes per pixel.
    pub(super) fn pixel_bytes(&self) -> usize {
        match self.format {
            PixelFormat::Grey | PixelFormat::Nv12 | PixelFormat::Mjpg => 1,
            PixelFormat::Yuyv | PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => 2,
            PixelFormat::Rgb3 => 3,
        }
    }

    /// Bytes of a row, without padding.
    pub(super) fn row_bytes(&self) -> usize {
        self.size[0] as usize * self.pixel_bytes()
    }

    /// The distance between rows in bytes. A stride shorter than a row means that there is no padding.
    pub(super) fn stride(&self) -> usize {
        self.row_bytes().max(self.stride as usize)
    }
}

/// `640x480 YUYV`.
impl fmt::Display for FrameLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        write!(f, "{width}x{height} {}", self.format.name())
    }
}
