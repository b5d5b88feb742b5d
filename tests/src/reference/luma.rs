//! The grey values of a camera frame, pixel by pixel, straight from the definitions of the pixel formats.

use multiscopic::capture::camera::{FrameLayout, PixelFormat};

/// The grey value of each pixel of an uncompressed frame, row by row.
///
/// # Panics
/// If the frame is too short or compressed.
pub fn gray(layout: &FrameLayout, frame: &[u8]) -> Vec<u8> {
    let [width, height] = layout.size.map(|side| side as usize);
    let bytes = match layout.format {
        PixelFormat::Grey | PixelFormat::Nv12 => 1,
        PixelFormat::Yuyv | PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => 2,
        PixelFormat::Rgb3 => 3,
        PixelFormat::Mjpg => panic!("a compressed frame"),
    };
    let stride = if layout.stride == 0 { width * bytes } else { layout.stride as usize };
    let pixel = |u: usize, v: usize| {
        let at = |i: usize| u32::from(frame[v * stride + u * bytes + i]);
        let word = || at(0) + 256 * at(1);
        let gray = match layout.format {
            PixelFormat::Y10 => word() % 1024 / 4,
            PixelFormat::Y12 => word() % 4096 / 16,
            PixelFormat::Y16 => word() / 256,
            PixelFormat::Rgb3 => (77 * at(0) + 150 * at(1) + 29 * at(2) + 128) / 256,
            _ => at(0),
        };
        u8::try_from(gray).expect("8 bits")
    };
    (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| pixel(u, v)).collect()
}
