//! Converting a camera's frames to grey.

use std::path::Path;

use image::GrayImage;

use super::{error::CameraFault, frame_layout::FrameLayout, jpeg};
use crate::{
    capture::camera::format::PixelFormat,
    error::Error,
    images::{Picture, gray_of},
};

impl FrameLayout {
    /// Converts a frame to grey. Bytes beyond the last row are ignored.
    ///
    /// # Errors
    /// [`CameraFault::Truncated`] if there are too few bytes, [`CameraFault::Jpeg`] if they are not a JPEG
    /// image of this size.
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

    /// Converts each pixel's bytes to grey.
    fn convert(&self, frame: &[u8], gray: impl Fn(&[u8]) -> u8) -> Result<GrayImage, CameraFault> {
        let (found, expected) = (frame.len() as u64, self.bytes());
        if found < expected {
            return Err(CameraFault::Truncated { found, expected, layout: *self });
        }
        let [width, height] = self.size;
        let rows = frame.chunks(self.stride().max(1)).take(height as usize).map(|row| &row[..self.row_bytes()]);
        let pixels = rows.flat_map(|row| row.chunks_exact(self.pixel_bytes())).map(gray).collect();
        Ok(GrayImage::from_raw(width, height, pixels).expect("every row has the width of the image"))
    }

    /// Decodes a JPEG image to grey.
    fn decode(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        let wrong = |found: String| CameraFault::Jpeg { found, layout: *self };
        let picture = Picture::decode(Path::new(""), &jpeg::mark_without_tables(frame)).map_err(|error| match error {
            Error::Format { found, .. } => wrong(found),
            error => wrong(error.to_string()),
        })?;
        match picture.dimensions() {
            (width, height) if [width, height] == self.size => Ok(picture.to_gray()),
            (width, height) => Err(wrong(format!("an image of {width}x{height}"))),
        }
    }
}
