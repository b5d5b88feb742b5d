//! Finding the corners of the centre in a view, by an image at half its size, and again, to search over long distances.
//!
//! ```text
//! corners:        in each cell of a grid, the pixel whose least gradient over all directions is greatest (Shi and Tomasi), unless
//!                 it is on an edge, along which matches slide
//! find:           at the coarsest level of the pyramid, correlate the patch with every place in the range and its margin
//!                 at each finer level, with the 6x6 places around twice the best
//!                 refine the best below a pixel
//! refine:         least squares over position, contrast and brightness (Lucas and Kanade), and over two slopes along the
//!                 baseline if asked for; drop it if it moves more than two pixels or explains too little
//! find again:     refine in the view as rectified by a rough model, from where that model expects the corner
//! keep consensus: fit the offsets across the baseline by random samples (RANSAC), linear in place and parallax; drop the
//!                 matches that are more than a pixel off
//! ```

use std::ops::RangeInclusive;

use image::GrayImage;
use multiscopic_core::View;
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::view_geometry::Direction;
use crate::images::{InterpolatedImage, extended_pixel};

/// The least correlation of a corner with its match.
pub const MIN_CORRELATION: f32 = 0.8;
/// The distance to which a match is searched outside the range of disparities, as a share of the image's larger side: rotations
/// of a degree and more shift a view by as much.
const MARGIN: f64 = 0.06;
/// The maximum number of iterations of the refinement below a pixel.
const MAX_ITERATIONS: usize = 15;
/// The most by which a disparity may change from a pixel to the next.
const MAX_SLOPE: f64 = 0.7;
/// The weight of no change: the variance of grey values, about 3 squared, over that of slopes, about 0.2 squared.
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

/// Finds `corners` of the centre in a view near the places where they are expected, which are given in a rectified view: `map`
/// leads from there to the pixels of the view. Disparities may vary with the pixels around a corner, as those of a slanted
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
    // Where matches lie, and around them the margin.
    let side = center.levels[0].width.max(center.levels[0].height);
    let margin = MARGIN * side as f64 + 2.0;
    let ends = [*range.start(), *range.end()].map(|d| view.shift(d));
    let [columns, rows] = [(corner[0], ends.map(|(du, _)| du)), (corner[1], ends.map(|(_, dv)| dv))].map(|(at, [a, b])| {
        let level = |at: f64| at_level(at, top);
        level(at as f64 + f64::from(a.min(b)) - margin)..=level(at as f64 + f64::from(a.max(b)) + margin)
    });
    let at = best([&center.levels[top], &neighbor.levels[top]], corner.map(|at| at_level(at as f64, top)), columns, rows)?;
    to_largest([center, neighbor], corner, at)
}

/// The pixel of a level of a pyramid in which a place of its largest image is.
pub fn at_level(at: f64, level: usize) -> isize {
    ((at + 0.5) / f64::from(1 << level) - 0.5).round() as isize
}

/// The pixel nearest to the match of a corner, given the one in the smallest images.
pub fn to_largest([center, neighbor]: [&Pyramid; 2], corner: [usize; 2], mut at: [isize; 2]) -> Option<[f64; 2]> {
    for level in (0..center.levels.len() - 1).rev() {
        let [u, v] = at.map(|at| 2 * at);
        let here = corner.map(|at| at_level(at as f64, level));
        at = best([&center.levels[level], &neighbor.levels[level]], here, u - 2..=u + 3, v - 2..=v + 3)?;
    }
    Some(at.map(|at| at as f64))
}

/// The place in some columns and rows of a view that is most like the pixels around a place of the centre.
fn best(
    [center, neighbor]: [&Level; 2],
    here: [isize; 2],
    columns: RangeInclusive<isize>,
    rows: RangeInclusive<isize>,
) -> Option<[isize; 2]> {
    let patch = center.patch(here)?;
    let candidates = rows.flat_map(|v| columns.clone().map(move |u| [u, v]));
    let correlations = candidates.filter_map(|at| Some((neighbor.correlation(&patch, at)?, at)));
    let (correlation, at) = correlations.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (correlation >= MIN_CORRELATION).then_some(at)
}

/// The match below a pixel, by least squares over the position, the contrast and the brightness (Lucas and Kanade, 1981), and
/// over how much the square is stretched and sheared `along` the baseline with each pixel to the right and down, if that is
/// given.
///
/// `square` gives the pixels around a point of the view for these two slopes.
pub(super) fn refine(
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

/// Pixels around a corner that its texture is measured in, to each side.
const CORNER_RADIUS: usize = 4;
/// The least root mean square gradient of a corner, in any direction, in grey values per pixel.
const MIN_CONTRAST: f32 = 2.0;
/// The least share of its greatest mean square gradient that a corner has in every direction.
const EDGE: f32 = 0.1;

/// About `count` corners, spread over the image: in each cell of a grid the one whose least gradient, over all
/// directions, is greatest (Shi and Tomasi, "Good features to track", 1994). None is on an edge, or closer to a border than `margin`.
pub fn corners(image: &GrayImage, count: usize, margin: usize) -> Vec<[usize; 2]> {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let margin = margin.max(CORNER_RADIUS + 1);
    let (Some(inner_width), Some(inner_height)) = (width.checked_sub(2 * margin), height.checked_sub(2 * margin)) else {
        return Vec::new();
    };
    let strength = strengths(image);
    let cell = (inner_width * inner_height / count.max(1)).isqrt().max(4);
    let mut corners = Vec::new();
    for top in (margin..margin + inner_height).step_by(cell) {
        for left in (margin..margin + inner_width).step_by(cell) {
            let rows = top..(top + cell).min(margin + inner_height);
            let columns = left..(left + cell).min(margin + inner_width);
            let pixels = rows.flat_map(|v| columns.clone().map(move |u| [u, v]));
            let best = pixels.max_by(|a, b| strength[a[1] * width + a[0]].total_cmp(&strength[b[1] * width + b[0]]));
            corners.extend(best.filter(|[u, v]| strength[v * width + u] >= MIN_CONTRAST * MIN_CONTRAST));
        }
    }
    corners
}

/// The lesser eigenvalue of the mean structure tensor around each pixel, or 0 on an edge, along which matches slide.
fn strengths(image: &GrayImage) -> Vec<f32> {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let at = |u, v| extended_pixel(image, u, v);
    let mut tensors = [const { Vec::new() }; 3];
    for (v, u) in (0..height as isize).flat_map(|v| (0..width as isize).map(move |u| (v, u))) {
        let x = (at(u + 1, v) - at(u - 1, v)) as f32 / 2.0;
        let y = (at(u, v + 1) - at(u, v - 1)) as f32 / 2.0;
        tensors.iter_mut().zip([x * x, x * y, y * y]).for_each(|(tensor, product)| tensor.push(product));
    }
    let [xx, xy, yy] = tensors.map(|tensor| box_means(&tensor, width, height));
    let lesser = |((a, b), c): ((&f32, &f32), &f32)| {
        let difference = ((a - c).powi(2) + 4.0 * b * b).sqrt();
        let [lesser, greater] = [a + c - difference, a + c + difference];
        if lesser >= EDGE * greater { lesser / 2.0 } else { 0.0 }
    };
    xx.iter().zip(&xy).zip(&yy).map(lesser).collect()
}

/// The means over the `2 CORNER_RADIUS + 1` pixels square around each pixel; wrong near the borders.
fn box_means(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let side = 2 * CORNER_RADIUS + 1;
    let along = |values: &[f32], count: usize, stride: usize, start: usize, means: &mut [f32]| {
        let at = |i: usize| f64::from(values[start + i * stride]);
        let mut sum: f64 = (0..side.min(count)).map(at).sum();
        for i in CORNER_RADIUS..count.saturating_sub(CORNER_RADIUS) {
            means[start + i * stride] = (sum / side as f64) as f32;
            if i + CORNER_RADIUS + 1 < count {
                sum += at(i + CORNER_RADIUS + 1) - at(i - CORNER_RADIUS);
            }
        }
    };
    let (mut rows, mut means) = (vec![0.0; values.len()], vec![0.0; values.len()]);
    (0..height).for_each(|v| along(values, width, 1, v * width, &mut rows));
    (0..width).for_each(|u| along(&rows, height, width, u, &mut means));
    means
}

/// The number of random samples.
const SAMPLES: usize = 500;
/// The largest distance of a match from where the others expect it, across the baseline, in pixels.
const TOLERANCE: f64 = 1.0;

/// Drops the matches that do not agree with most others (RANSAC: Fischler and Bolles, 1981): how far a view shows a corner
/// across its baseline is nearly linear in the corner's coordinates and its parallax.
pub fn keep_consensus(corners: &[[usize; 2]], matches: &mut [Option<Match>], direction: Direction, size: [usize; 2]) {
    let half = size[0].max(size[1]) as f64 / 2.0;
    let rows: Vec<(usize, [f64; 4], f64)> = corners
        .iter()
        .zip(&*matches)
        .enumerate()
        .filter_map(|(k, (corner, found))| {
            let corner = corner.map(|at| at as f64);
            let [du, dv] = [0, 1].map(|axis| found.as_ref().map(|found| found.at[axis] - corner[axis]));
            let along = |[x, y]: [f64; 2]| Some(x * du? + y * dv?);
            let [x, y] = [0, 1].map(|axis| (corner[axis] - size[axis] as f64 / 2.0) / half);
            Some((k, [1.0, x, y, along(direction.along)? / half], along(direction.across)?))
        })
        .collect();
    if rows.len() < 5 {
        return;
    }
    let agrees = |model: &[f64; 4], row: &(usize, [f64; 4], f64)| {
        let expected: f64 = model.iter().zip(row.1).map(|(a, b)| a * b).sum();
        (row.2 - expected).abs() <= TOLERANCE
    };
    let mut random = fastrand::Rng::with_seed(1);
    let mut best = (0, [0.0; 4]);
    for _ in 0..SAMPLES {
        let sample: Vec<_> = (0..6).map(|_| &rows[random.usize(..rows.len())]).collect();
        if let Some(model) = fit(sample.iter().map(|row| (row.1, row.2))) {
            let support = rows.iter().filter(|row| agrees(&model, row)).count();
            best = if support > best.0 { (support, model) } else { best };
        }
    }
    for _ in 0..3 {
        let model = best.1;
        best.1 = fit(rows.iter().filter(|row| agrees(&model, row)).map(|row| (row.1, row.2))).unwrap_or(model);
    }
    for row in rows.iter().filter(|row| !agrees(&best.1, row)) {
        matches[row.0] = None;
    }
}

/// The least-squares solution of linear equations. Parallax hardly matters, so that its coefficient is drawn to 0 where the
/// rows do not determine it.
fn fit(rows: impl Iterator<Item = ([f64; 4], f64)>) -> Option<[f64; 4]> {
    let mut matrix = nalgebra::Matrix4::from_diagonal(&nalgebra::Vector4::new(1e-9, 1e-9, 1e-9, 1e-3));
    let mut right = nalgebra::Vector4::zeros();
    for (row, value) in rows {
        let row = nalgebra::Vector4::from(row);
        matrix += row * row.transpose();
        right += row * value;
    }
    Some(matrix.cholesky()?.solve(&right).into())
}

/// The widest image in which a search is exhaustive.
const COARSEST: usize = 240;
/// Pixels around a corner that are compared, to each side.
pub const RADIUS: usize = 5;
/// The side of the square that is compared.
const PATCH_SIDE: usize = 2 * RADIUS + 1;
/// The least norm of a square that can be compared.
const MIN_NORM: f32 = 0.03;

/// An image in grey at descending sizes, the largest first.
pub struct Pyramid {
    pub levels: Vec<Level>,
}

/// An image of a pyramid.
pub struct Level {
    pub width: usize,
    pub height: usize,
    pixels: Vec<f32>,
    /// For each square inside the image, by its top left pixel: the norm of its pixels less their mean.
    norms: Vec<f32>,
}

impl Pyramid {
    pub fn new(image: &GrayImage) -> Pyramid {
        let mut levels = vec![Level::of(image)];
        while let Some(last) = levels.last().filter(|last| last.width.max(last.height) > COARSEST) {
            levels.push(last.half());
        }
        Pyramid { levels }
    }
}

impl Level {
    pub fn of(image: &GrayImage) -> Level {
        let pixels = image.as_raw().iter().copied().map(f32::from).collect();
        Level::new(image.width() as usize, image.height() as usize, pixels)
    }

    /// The share of squares in which the standard deviation is less than `deviation`.
    pub fn share_below(&self, deviation: f32) -> f64 {
        let (columns, rows) = ((self.width + 1).saturating_sub(PATCH_SIDE), (self.height + 1).saturating_sub(PATCH_SIDE));
        let inside = self.norms.chunks(self.width).take(rows).flat_map(|norms| &norms[..columns]);
        let below = inside.filter(|norm| **norm < deviation * PATCH_SIDE as f32).count();
        below as f64 / (columns * rows).max(1) as f64
    }

    fn new(width: usize, height: usize, pixels: Vec<f32>) -> Level {
        let norms = norms(width, height, &pixels);
        Level { width, height, pixels, norms }
    }

    /// The mean of every two by two pixels.
    fn half(&self) -> Level {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |u: usize, v: usize| {
            let at = |u: usize, v: usize| self.pixels[v * self.width + u];
            (at(2 * u, 2 * v) + at(2 * u + 1, 2 * v) + at(2 * u, 2 * v + 1) + at(2 * u + 1, 2 * v + 1)) / 4.0
        };
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| mean(u, v)).collect();
        Level::new(width, height, pixels)
    }

    /// The top left pixel of the square around `(u, v)`, and the norm of its pixels less their mean. `None` if they are not
    /// all inside the image or all alike.
    fn square(&self, [u, v]: [isize; 2]) -> Option<(usize, f32)> {
        let left = usize::try_from(u).ok()?.checked_sub(RADIUS)?;
        let top = usize::try_from(v).ok()?.checked_sub(RADIUS)?;
        if left + PATCH_SIDE > self.width || top + PATCH_SIDE > self.height {
            return None;
        }
        let start = top * self.width + left;
        Some((start, self.norms[start])).filter(|(_, norm)| *norm > MIN_NORM)
    }

    fn rows(&self, start: usize) -> impl Iterator<Item = &[f32]> {
        self.pixels[start..].chunks(self.width).take(PATCH_SIDE).map(|row| &row[..PATCH_SIDE])
    }

    /// The pixels of the square around `(u, v)` in rows, less their mean and divided by their norm. `None` if they are not
    /// all inside the image or all alike.
    pub fn patch(&self, at: [isize; 2]) -> Option<Vec<f32>> {
        let (start, norm) = self.square(at)?;
        let mut patch: Vec<f32> = self.rows(start).flatten().copied().collect();
        let mean = patch.iter().sum::<f32>() / patch.len() as f32;
        patch.iter_mut().for_each(|pixel| *pixel = (*pixel - mean) / norm);
        Some(patch)
    }

    /// The correlation of a patch with the pixels around `(u, v)`: 1 if they differ only in contrast and brightness. `None`
    /// if those are not all inside the image or all alike.
    pub fn correlation(&self, patch: &[f32], at: [isize; 2]) -> Option<f32> {
        let (start, norm) = self.square(at)?;
        let mut products = [0.0; PATCH_SIDE];
        for (patch, row) in patch.chunks_exact(PATCH_SIDE).zip(self.rows(start)) {
            products.iter_mut().zip(patch).zip(row).for_each(|((product, a), b)| *product += a * b);
        }
        // The patch has the mean 0, so that of the pixels does not count.
        Some(products.iter().sum::<f32>() / norm)
    }
}

/// The norms of all squares, by summed areas.
fn norms(width: usize, height: usize, pixels: &[f32]) -> Vec<f32> {
    let stride = width + 1;
    let mut areas = vec![[0.0_f64; 2]; stride * (height + 1)];
    for v in 0..height {
        let mut row = [0.0; 2];
        for u in 0..width {
            let pixel = f64::from(pixels[v * width + u]);
            row = [row[0] + pixel, row[1] + pixel * pixel];
            areas[(v + 1) * stride + u + 1] = [0, 1].map(|k| areas[v * stride + u + 1][k] + row[k]);
        }
    }
    let mut norms = vec![0.0; width * height];
    for v in 0..(height + 1).saturating_sub(PATCH_SIDE) {
        for u in 0..(width + 1).saturating_sub(PATCH_SIDE) {
            let corner = |down: usize, right: usize| areas[(v + down) * stride + u + right];
            let [[a, b], [c, d]] =
                [[corner(0, 0), corner(0, PATCH_SIDE)], [corner(PATCH_SIDE, 0), corner(PATCH_SIDE, PATCH_SIDE)]];
            let [sum, squares] = [0, 1].map(|k| d[k] - c[k] - b[k] + a[k]);
            let variance = squares - sum * sum / (PATCH_SIDE * PATCH_SIDE) as f64;
            norms[v * width + u] = variance.max(0.0).sqrt() as f32;
        }
    }
    norms
}
