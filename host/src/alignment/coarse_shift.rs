//! The shift of a view across its baseline in whole pixels.

use image::GrayImage;
use multiscopic_core::{Frame, Fusion, Params, View, Views};

use super::correction::corrected;
use crate::{
    error::Result,
    images::{DisparityMap, Frames},
    stereo::Engine,
};

/// The largest shift across the baseline that is searched, in pixels.
pub const MAX_SHIFT: i32 = 5;

/// The grey difference at which the cost of a pixel is capped. Pixels without a disparity cost this much too.
const MAX_DIFFERENCE: f64 = 20.0;

/// Matches `neighbor` with `center` at every shift up to [`MAX_SHIFT`]. Returns the shift of least cost, with
/// its disparities.
///
/// # Errors
/// If `params` are for frames of another size.
pub fn coarse_shift(
    [center, neighbor]: [&GrayImage; 2],
    view: View,
    params: &Params,
    engine: &Engine,
    gain: f64,
) -> Result<(i32, DisparityMap)> {
    let params = Params::new(
        params.width() as u16,
        params.height() as u16,
        Views::NONE.with(view),
        Fusion::Min,
        params.min_disparity(),
        params.num_disparities() as u16,
        params.block_size() as u8,
    )?;
    let mut frames = Frames::new(center.clone());
    let mut best: Option<(f64, i32, DisparityMap)> = None;
    for shift in -MAX_SHIFT..=MAX_SHIFT {
        frames = frames.with(view, corrected(neighbor, view, shift.into(), gain));
        let disparities = engine.disparities(&frames, &params, || ())?;
        let cost = matching_cost(&frames, view, &disparities);
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, shift, disparities));
        }
    }
    let (_, shift, disparities) = best.expect("there is more than one shift");
    Ok((shift, disparities))
}

/// The sum over all pixels of the capped grey difference to their match.
fn matching_cost(frames: &Frames, view: View, disparities: &DisparityMap) -> f64 {
    let [width, height] = frames.size();
    let [center, neighbor] = [Frame::Center, Frame::View(view)].map(|frame| frames.get(frame).expect("these frames have both"));
    let mut sum = 0.0;
    for (v, row) in disparities.rows().enumerate() {
        for (u, disparity) in row.iter().enumerate() {
            sum += disparity.map_or(MAX_DIFFERENCE, |disparity| {
                let (du, dv) = view.shift(disparity.to_fixed().round().to_num());
                let matched = [(u, du, width), (v, dv, height)].map(|(at, shift, size)| clamped(at, shift, size));
                let gray = |image: &GrayImage, [u, v]: [u32; 2]| f64::from(image.get_pixel(u, v).0[0]);
                (gray(center, [u as u32, v as u32]) - gray(neighbor, matched)).abs().min(MAX_DIFFERENCE)
            });
        }
    }
    sum
}

/// A coordinate moved by `shift`, but not beyond the border.
fn clamped(at: usize, shift: i32, size: usize) -> u32 {
    (at as i64 + i64::from(shift)).clamp(0, size as i64 - 1) as u32
}
