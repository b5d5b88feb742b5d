//! The layout of a camera's frames in memory, and their conversion to grey.

use std::{fmt, path::Path};

use image::GrayImage;

use crate::images::{Picture, gray_of};

use super::{error::CameraFault, format::PixelFormat, jpeg};

/// How a camera's frames are laid out in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLayout {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Bytes from the start of a row to the start of the next; 0 if rows are not padded. JPEG images have no stride.
    pub stride: u32,
}

impl FrameLayout {
    /// Converts a frame to grey. Bytes beyond the last row are ignored.
    ///
    /// # Errors
    /// [`CameraFault::Truncated`] if there are too few bytes, [`CameraFault::Jpeg`] if they are not a JPEG image of this size.
    pub fn to_gray(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        let word = |shift: u32| move |word: &[u8]| (u16::from_le_bytes([word[0], word[1]]) >> shift) as u8;
        match self.format {
            // YUYV has luma in the first of a pixel's two bytes.
            PixelFormat::Grey | PixelFormat::Nv12 | PixelFormat::Yuyv => self.convert(frame, |pixel: &[u8]| pixel[0]),
            PixelFormat::Y10 => self.convert(frame, word(2)),
            PixelFormat::Y12 => self.convert(frame, word(4)),
            PixelFormat::Y16 => self.convert(frame, word(8)),
            PixelFormat::Rgb3 => self.convert(frame, |pixel: &[u8]| gray_of([pixel[0], pixel[1], pixel[2]])),
            PixelFormat::Mjpg => self.decode(frame),
        }
    }

    /// The fewest bytes that a frame can have: its last row need not be padded.
    fn bytes(&self) -> u64 {
        let [width, height] = self.size.map(u64::from);
        let stride = self.stride() as u64;
        let luma = height.saturating_sub(1) * stride;
        match self.format {
            // One row of chroma for every two of luma.
            PixelFormat::Nv12 => luma + height.div_ceil(2) * stride + 2 * width.div_ceil(2),
            _ => luma + self.row_bytes() as u64,
        }
    }

    /// Bytes per pixel.
    fn pixel_bytes(&self) -> usize {
        match self.format {
            PixelFormat::Grey | PixelFormat::Nv12 | PixelFormat::Mjpg => 1,
            PixelFormat::Yuyv | PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => 2,
            PixelFormat::Rgb3 => 3,
        }
    }

    /// Bytes of a row, without padding.
    fn row_bytes(&self) -> usize {
        self.size[0] as usize * self.pixel_bytes()
    }

    /// The distance between rows in bytes. A stride shorter than a row means that there is no padding.
    fn stride(&self) -> usize {
        self.row_bytes().max(self.stride as usize)
    }

    /// Converts each pixel's bytes to grey.
    fn convert(&self, frame: &[u8], gray: impl Fn(&[u8]) -> u8) -> Result<GrayImage, CameraFault> {
        let (found, expected) = (frame.len() as u64, self.bytes());
        if found < expected {
            return Err(CameraFault::Truncated { found, expected, layout: *self });
        }
        let [width, height] = self.size;
        let rows = frame.chunks(self.stride()).take(height as usize).map(|row| &row[..self.row_bytes()]);
        let pixels = rows.flat_map(|row| row.chunks_exact(self.pixel_bytes())).map(gray).collect();
        Ok(GrayImage::from_raw(width, height, pixels).expect("every row has the width of the image"))
    }

    /// Decodes a JPEG image to grey.
    fn decode(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        let wrong = |found: String| CameraFault::Jpeg { found, layout: *self };
        let picture = Picture::decode(Path::new(""), &jpeg::with_tables(frame)).map_err(|error| match error {
            crate::error::Error::Format { found, .. } => wrong(found),
            error => wrong(error.to_string()),
        })?;
        match picture.dimensions() {
            (width, height) if [width, height] == self.size => Ok(picture.to_gray()),
            (width, height) => Err(wrong(format!("an image of {width}x{height}"))),
        }
    }
}

/// `640x480 YUYV`.
impl fmt::Display for FrameLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        write!(f, "{width}x{height} {}", self.format.name())
    }
}
