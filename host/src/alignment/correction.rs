//! Correcting the shift and the brightness of a view.

use image::{GrayImage, Luma};
use multiscopic_core::View;

use super::oriented::{OrientedImage, along_and_across};

/// The image of a view moved back by `across_px` across its baseline, with its grey values divided by `gain`.
pub fn corrected(image: &GrayImage, view: View, across_px: f64, gain: f64) -> GrayImage {
    let source = OrientedImage::new(image, view);
    GrayImage::from_fn(image.width(), image.height(), |u, v| {
        let [along, across] = along_and_across([u, v], view).map(f64::from);
        let gray = source.interpolate(along, across + across_px) / gain;
        Luma([gray.round().clamp(0.0, 255.0) as u8])
    })
}
