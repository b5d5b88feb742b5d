//! Finding the corners of the centre in a view.

use std::ops::RangeInclusive;

use image::GrayImage;
use multiscopic_core::View;
use rayon::prelude::*;

use super::pyramid::{Pyramid, RADIUS};
use crate::images::InterpolatedImage;

/// The least correlation of a corner with its match.
const MIN_CORRELATION: f32 = 0.8;
/// How far a match is searched outside the range of disparities, as a share of the image's larger side: rotations of a
/// degree and more shift a view by as much.
const MARGIN: f64 = 0.06;
/// The maximum number of iterations of the refinement below a pixel.
const MAX_ITERATIONS: usize = 12;
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
    let images = [center.0, neighbor.0].map(InterpolatedImage::new);
    let pyramids = [center.1, neighbor.1];
    let square = |at| images[1].square(at, SIDE);
    let find = |&corner: &[usize; 2]| {
        let nearby = find_nearby(pyramids, corner, view, range)?;
        refine(&images[0], square, corner, nearby)
    };
    corners.par_iter().map(find).collect()
}

/// Finds `corners` of the centre in a view near the places where they are expected, which are given in a rectified view:
/// `map` leads from there to the pixels of the view.
pub fn find_again(
    [center, neighbor]: [&GrayImage; 2],
    corners: &[[usize; 2]],
    expected: &[Option<[f64; 2]>],
    map: impl Fn([f64; 2]) -> [f64; 2] + Sync,
) -> Vec<Option<Match>> {
    let [center, neighbor] = [center, neighbor].map(InterpolatedImage::new);
    let square = |[u, v]: [f64; 2]| {
        let offsets = (-SIDE..=SIDE).flat_map(|j| (-SIDE..=SIDE).map(move |i| [i as f64, j as f64]));
        offsets.map(|[i, j]| neighbor.at(map([u + i, v + j]))).collect()
    };
    let find = |(&corner, expected): (&[usize; 2], &Option<[f64; 2]>)| {
        let found = refine(&center, square, corner, (*expected)?)?;
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

/// The match below a pixel, by least squares over the position, the contrast and the brightness (Lucas and Kanade, 1981).
/// `square` gives the pixels around a point of the view.
fn refine(
    center: &InterpolatedImage,
    square: impl Fn([f64; 2]) -> Vec<f64>,
    corner: [usize; 2],
    start: [f64; 2],
) -> Option<Match> {
    let [cu, cv] = corner.map(|at| at as isize);
    let mut template = Vec::with_capacity((2 * RADIUS + 1).pow(2));
    for (j, i) in (-SIDE..=SIDE).flat_map(|j| (-SIDE..=SIDE).map(move |i| (j, i))) {
        let at = |i: isize, j: isize| center.pixel(cu + i, cv + j);
        let gradient = [(at(i + 1, j) - at(i - 1, j)) / 2.0, (at(i, j + 1) - at(i, j - 1)) / 2.0];
        template.push((at(i, j), gradient));
    }
    let count = template.len() as f64;
    let mean = template.iter().map(|(pixel, _)| pixel).sum::<f64>() / count;
    let variance = template.iter().map(|(pixel, _)| (pixel - mean).powi(2)).sum::<f64>() / count;
    let mut at = start;
    for _ in 0..MAX_ITERATIONS {
        let found = square(at);
        let found_mean = found.iter().sum::<f64>() / count;
        let product = template.iter().zip(&found).map(|((pixel, _), found)| (pixel - mean) * (found - found_mean)).sum::<f64>();
        let contrast = product / count / variance;
        let (mut matrix, mut right, mut squares) = ([0.0; 3], [0.0; 2], 0.0);
        for ((pixel, [x, y]), found) in template.iter().zip(&found) {
            let (x, y) = (contrast * x, contrast * y);
            let difference = found - found_mean - contrast * (pixel - mean);
            matrix = [matrix[0] + x * x, matrix[1] + x * y, matrix[2] + y * y];
            right = [right[0] + x * difference, right[1] + y * difference];
            squares += difference * difference;
        }
        let determinant = matrix[0] * matrix[2] - matrix[1] * matrix[1];
        let step = [
            (matrix[2] * right[0] - matrix[1] * right[1]) / determinant,
            (matrix[0] * right[1] - matrix[1] * right[0]) / determinant,
        ];
        at = [at[0] - step[0], at[1] - step[1]];
        // A refinement by more than two pixels has left the match.
        if !step.iter().all(|step| step.is_finite()) || (0..2).any(|k| (at[k] - start[k]).abs() > 2.0) {
            return None;
        }
        if step[0].hypot(step[1]) < 0.003 {
            let explained = contrast * contrast * variance * count;
            let is_found = contrast > 0.0 && squares < explained * f64::from(1.0 / MIN_CORRELATION.powi(2) - 1.0);
            return is_found.then_some(Match { at, gain: found_mean / mean.max(1.0) });
        }
    }
    None
}
