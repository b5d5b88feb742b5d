//! The left-right check: a disparity stays only if a view confirms it.

use multiscopic_core::{SearchSpace, View};

use crate::{
    images::{DisparityMap, Raster},
    stereo::cost::{Cost, Volume},
};

/// The disparities of the pixels of `view`, in whole pixels, by the costs of the centre.
///
/// A pixel of the view takes the candidate of least cost among those of the centre whose match it is;
/// ties go to the smallest disparity. It has none if it is the match of no candidate.
pub fn view_disparities<C: Cost>(costs: &Volume<C>, search: &SearchSpace, view: View) -> Raster<Option<i16>> {
    let size = (costs.width(), costs.height());
    let mut least: Raster<Option<(C, i16)>> = Raster::filled(size.0, size.1, None);
    for v in 0..costs.height() {
        for u in 0..costs.width() {
            for (&cost, d) in costs.pixel(u, v)[..search.num_disparities()].iter().zip(search.min_disparity()..) {
                let Some((x, y)) = view.match_of((u, v), d, size) else { continue };
                let pixel = &mut least.row_mut(y)[x];
                let is_better = pixel.is_none_or(|best| cost < best.0 || (cost == best.0 && d < best.1));
                if cost != C::NONE && is_better {
                    *pixel = Some((cost, d));
                }
            }
        }
    }
    least.map(|pixel| pixel.map(|(_, d)| d))
}

/// Invalidates the pixels of `map` that no view confirms.
///
/// A view confirms a disparity if its own disparity at the match, by
/// [`view_disparities`], differs by at most `tolerance` pixels. Disparities are
/// rounded to whole pixels first, halves away from zero.
pub fn check_left_right<C: Cost>(costs: &Volume<C>, search: &SearchSpace, map: &mut DisparityMap, tolerance: u16) {
    let size = (costs.width(), costs.height());
    let views: Vec<_> = search.views().iter().map(|view| (view, view_disparities(costs, search, view))).collect();
    for (v, row) in map.rows_mut().enumerate() {
        for (u, pixel) in row.iter_mut().enumerate() {
            let Some(d) = pixel.map(|d| f32::from(d).round() as i16) else { continue };
            let is_confirmed = views.iter().any(|(view, disparities)| {
                let found = view.match_of((u, v), d, size).and_then(|(x, y)| disparities.get(x, y));
                found.is_some_and(|found| found.abs_diff(d) <= tolerance)
            });
            if !is_confirmed {
                *pixel = None;
            }
        }
    }
}
