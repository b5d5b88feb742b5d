//! Correcting the shift and the brightness of a view.

use image::{GrayImage, Luma};
use multiscopic_core::View;

use super::{direction::Direction, interpolated::InterpolatedImage};

/// The image of a view moved back by `across_px` across its baseline, with its grey values divided by `gain`.
pub fn corrected(image: &GrayImage, view: View, across_px: f64, gain: f64) -> GrayImage {
    let (source, Direction { across: [du, dv], .. }) = (InterpolatedImage(image), Direction::of(view));
    GrayImage::from_fn(image.width(), image.height(), |u, v| {
        let gray = source.interpolate(f64::from(u) + du * across_px, f64::from(v) + dv * across_px) / gain;
        Luma([gray.round().clamp(0.0, 255.0) as u8])
    })
}
