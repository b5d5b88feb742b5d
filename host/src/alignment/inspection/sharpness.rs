//! The sharpness of images, and their clipped pixels.

use image::GrayImage;
use multiscopic_core::Frame;

/// The share of the others' sharpness below which an image is blurred.
pub const MIN_SHARPNESS: f64 = 0.15;

/// The frames whose edges are much softer than those of most others.
pub fn blurred(frames: &[(Frame, &GrayImage)]) -> Vec<Frame> {
    let all: Vec<(Frame, f64)> = frames.iter().map(|&(frame, image)| (frame, sharpness(image))).collect();
    let mut sorted: Vec<f64> = all.iter().map(|(_, sharpness)| *sharpness).collect();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[sorted.len() / 2];
    all.into_iter().filter(|(_, sharpness)| *sharpness < MIN_SHARPNESS * usual).map(|(frame, _)| frame).collect()
}

/// The mean square difference of neighbouring pixels over the variance, which brightness and contrast do not change. 0 for an
/// image without any contrast.
pub fn sharpness(image: &GrayImage) -> f64 {
    let (width, pixels) = (image.width() as usize, image.as_raw());
    let count = pixels.len() as f64;
    let (mut sum, mut squares, mut differences) = (0_u64, 0_u64, 0_u64);
    let square = |a: u8, b: u8| u64::from(a.abs_diff(b)).pow(2);
    for (index, &pixel) in pixels.iter().enumerate() {
        sum += u64::from(pixel);
        squares += u64::from(pixel).pow(2);
        differences += pixels.get(index + width).map_or(0, |&below| square(pixel, below));
        if (index + 1) % width != 0 {
            differences += square(pixel, pixels[index + 1]);
        }
    }
    let variance = squares as f64 / count - (sum as f64 / count).powi(2);
    if variance > 0.0 { differences as f64 / count / variance } else { 0.0 }
}

/// The share of white pixels.
pub fn white_share(image: &GrayImage) -> f64 {
    let white = image.as_raw().iter().filter(|pixel| **pixel >= WHITE).count();
    white as f64 / image.as_raw().len() as f64
}

/// The least grey value of a pixel that may have been brighter.
const WHITE: u8 = 253;
