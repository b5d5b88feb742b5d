//! Finding the corners of the centre in a view.

use std::ops::RangeInclusive;

use image::GrayImage;
use multiscopic_core::View;
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::{
    direction::Direction,
    pyramid::{Pyramid, RADIUS},
};
use crate::images::{InterpolatedImage, extended_pixel};

/// The least correlation of a corner with its match.
const MIN_CORRELATION: f32 = 0.8;
/// How far a match is searched outside the range of disparities, as a share of the image's larger side: rotations of a
/// degree and more shift a view by as much.
const MARGIN: f64 = 0.06;
/// The maximum number of iterations of the refinement below a pixel.
const MAX_ITERATIONS: usize = 15;
/// How much a disparity may change from a pixel to the next.
const MAX_SLOPE: f64 = 0.7;
/// How firmly it is held at no change: the variance of grey values, about 3 squared, over that of slopes, about 0.2 squared.
const FLATNESS: f64 = 225.0;
/// Pixels around a corner that are compared, to each side.
const SIDE: isize = RADIUS as isize;

/// A corner of the centre, found in a view.
#[derive(Clone, Copy, Debug)]
pub struct Match {
    /// Its coordinates in the view.
    pub at: [f64; 2],
    /// Its brightness in the view relative to the centre.
    pub gain: f64,
}

/// Finds `corners` of the centre in `view`, whose disparities are in `range`. `None` where a corner is not found.
pub fn find(
    [center, neighbor]: [(&GrayImage, &Pyramid); 2],
    corners: &[[usize; 2]],
    view: View,
    range: &RangeInclusive<i16>,
) -> Vec<Option<Match>> {
    let image = InterpolatedImage::new(neighbor.0);
    let pyramids = [center.1, neighbor.1];
    let square = |at, _| image.square(at, SIDE);
    let find = |&corner: &[usize; 2]| {
        let nearby = find_nearby(pyramids, corner, view, range)?;
        refine(center.0, square, None, corner, nearby)
    };
    corners.par_iter().map(find).collect()
}

/// Finds `corners` of the centre in a view near the places where they are expected, which are given in a rectified view:
/// `map` leads from there to the pixels of the view. Disparities may vary with the pixels around a corner, as those of a slanted
/// surface do.
pub fn find_again(
    [center, neighbor]: [&GrayImage; 2],
    corners: &[[usize; 2]],
    view: View,
    expected: &[Option<[f64; 2]>],
    map: impl Fn([f64; 2]) -> [f64; 2] + Sync,
) -> Vec<Option<Match>> {
    let neighbor = InterpolatedImage::new(neighbor);
    let Direction { along: [ax, ay], .. } = Direction::of(view);
    let square = |[u, v]: [f64; 2], [right, down]: [f64; 2]| {
        let offsets = (-SIDE..=SIDE).flat_map(|j| (-SIDE..=SIDE).map(move |i| [i as f64, j as f64]));
        let place = |[i, j]: [f64; 2]| {
            let moved = right * i + down * j;
            [u + i + ax * moved, v + j + ay * moved]
        };
        offsets.map(|offset| neighbor.at(map(place(offset)))).collect()
    };
    let find = |(&corner, expected): (&[usize; 2], &Option<[f64; 2]>)| {
        let found = refine(center, square, Some([ax, ay]), corner, (*expected)?)?;
        Some(Match { at: map(found.at), ..found })
    };
    corners.par_iter().zip(expected).map(find).collect()
}

/// The pixel nearest to the match, by exhaustive search in small images and from there to larger ones.
fn find_nearby(
    [center, neighbor]: [&Pyramid; 2],
    corner: [usize; 2],
    view: View,
    range: &RangeInclusive<i16>,
) -> Option<[f64; 2]> {
    let top = center.levels.len() - 1;
    let at_level = |at: f64, level: usize| ((at + 0.5) / f64::from(1 << level) - 0.5).round() as isize;
    let patch = |level: usize| center.levels[level].patch(corner.map(|at| at_level(at as f64, level)));
    // Where matches lie, and around them the margin.
    let side = center.levels[0].width.max(center.levels[0].height);
    let margin = MARGIN * side as f64 + 2.0;
    let ends = [*range.start(), *range.end()].map(|d| view.shift(d));
    let bounds = [(corner[0], ends.map(|(du, _)| du)), (corner[1], ends.map(|(_, dv)| dv))].map(|(at, [a, b])| {
        let level = |at: f64| at_level(at, top);
        level(at as f64 + f64::from(a.min(b)) - margin)..=level(at as f64 + f64::from(a.max(b)) + margin)
    });
    let [columns, rows] = bounds;
    let best = |level: usize, columns: RangeInclusive<isize>, rows: RangeInclusive<isize>| {
        let patch = patch(level)?;
        let candidates = rows.flat_map(|v| columns.clone().map(move |u| [u, v]));
        let correlations = candidates.filter_map(|at| Some((neighbor.levels[level].correlation(&patch, at)?, at)));
        correlations.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(correlation, _)| *correlation >= MIN_CORRELATION)
    };
    let (_, mut at) = best(top, columns, rows)?;
    for level in (0..top).rev() {
        let [u, v] = at.map(|at| 2 * at);
        (_, at) = best(level, u - 2..=u + 3, v - 2..=v + 3)?;
    }
    Some(at.map(|at| at as f64))
}

/// The match below a pixel, by least squares over the position, the contrast and the brightness (Lucas and Kanade, 1981), and
/// over how much the square is stretched and sheared `along` the baseline with each pixel to the right and down, if that is
/// given.
///
/// `square` gives the pixels around a point of the view for these two slopes.
fn refine(
    center: &GrayImage,
    square: impl Fn([f64; 2], [f64; 2]) -> Vec<f64>,
    along: Option<[f64; 2]>,
    corner: [usize; 2],
    start: [f64; 2],
) -> Option<Match> {
    let [cu, cv] = corner.map(|at| at as isize);
    let [ax, ay] = along.unwrap_or_default();
    // A pixel less the mean, and what it changes by with the position and the slopes.
    let template = |(j, i): (isize, isize)| {
        let at = |i: isize, j: isize| extended_pixel(center, cu + i, cv + j);
        let [x, y] = [(at(i + 1, j) - at(i - 1, j)) / 2.0, (at(i, j + 1) - at(i, j - 1)) / 2.0];
        let slope = ax * x + ay * y;
        (at(i, j), Vector4::new(x, y, slope * i as f64, slope * j as f64))
    };
    let template: Vec<_> = (-SIDE..=SIDE).flat_map(|j| (-SIDE..=SIDE).map(move |i| (j, i))).map(template).collect();
    let count = template.len() as f64;
    let mean = template.iter().map(|(pixel, _)| pixel).sum::<f64>() / count;
    let variance = template.iter().map(|(pixel, _)| (pixel - mean).powi(2)).sum::<f64>() / count;
    let (mut at, mut slopes) = (start, [0.0; 2]);
    for _ in 0..MAX_ITERATIONS {
        let found = square(at, slopes);
        let found_mean = found.iter().sum::<f64>() / count;
        let product = template.iter().zip(&found).map(|((pixel, _), found)| (pixel - mean) * (found - found_mean)).sum::<f64>();
        let contrast = product / count / variance;
        let [right, down] = slopes;
        let mut matrix = Matrix4::from_diagonal(&Vector4::new(0.0, 0.0, FLATNESS, FLATNESS));
        let (mut gradient, mut squares) = (Vector4::new(0.0, 0.0, FLATNESS * right, FLATNESS * down), 0.0);
        for ((pixel, changes), found) in template.iter().zip(&found) {
            let changes = changes * contrast;
            let difference = found - found_mean - contrast * (pixel - mean);
            matrix += changes * changes.transpose();
            gradient += changes * difference;
            squares += difference * difference;
        }
        let step = matrix.cholesky()?.solve(&gradient);
        at = [at[0] - step[0], at[1] - step[1]];
        slopes = [right - step[2], down - step[3]];
        // A refinement by more than two pixels has left the match.
        let has_left = (0..2).any(|k| (at[k] - start[k]).abs() > 2.0 || slopes[k].abs() > MAX_SLOPE);
        if !step.iter().all(|step| step.is_finite()) || has_left {
            return None;
        }
        if step[0].hypot(step[1]) < 0.003 && step[2].hypot(step[3]) < 0.002 {
            let explained = contrast * contrast * variance * count;
            let is_found = contrast > 0.0 && squares < explained * f64::from(1.0 / MIN_CORRELATION.powi(2) - 1.0);
            return is_found.then_some(Match { at, gain: found_mean / mean.max(1.0) });
        }
    }
    None
}
