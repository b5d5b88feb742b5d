//! Windows of valid disparities, which the filters share. Invalid pixels stay invalid and never count.

use multiscopic_core::Disparity;
use rayon::prelude::*;

use crate::images::{DisparityMap, Raster};

/// The map with each valid pixel replaced by what `filter` makes of its column, row and disparity.
pub(super) fn filter_valid(
    map: &DisparityMap,
    filter: impl Fn(usize, usize, Disparity) -> Option<Disparity> + Sync,
) -> DisparityMap {
    let width = map.width();
    let pixels = map.pixels().par_iter().enumerate();
    let pixels = pixels.map(|(i, pixel)| pixel.and_then(|d| filter(i % width, i / width, d))).collect();
    Raster::new(width, map.height(), pixels)
}

/// The valid pixels in the window of `radius` around `(u, v)`: column, row and disparity.
pub(super) fn valid_in_window(
    map: &DisparityMap,
    u: usize,
    v: usize,
    radius: usize,
) -> impl Iterator<Item = (usize, usize, Disparity)> {
    let columns = u.saturating_sub(radius)..map.width().min(u + radius + 1);
    let rows = v.saturating_sub(radius)..map.height().min(v + radius + 1);
    rows.flat_map(move |y| columns.clone().filter_map(move |x| Some((x, y, map.get(x, y)?))))
}
