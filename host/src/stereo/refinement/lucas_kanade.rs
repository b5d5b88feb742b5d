//! Sub-pixel disparities by the gradients of images.

use std::{iter, ops::RangeInclusive};

use multiscopic_core::{Disparity, Frame, View, Views};
use rayon::prelude::*;

use crate::images::{DisparityMap, Frames, InterpolatedImage};

/// The number of iterations, each of which moves the disparities.
const ITERATIONS: usize = 3;
/// The standard deviation of the window in pixels, a Gaussian.
const SIGMA: f64 = 1.5;
/// The pixels on each side of the window's centre.
const RADIUS: usize = 3;
/// The largest difference of disparity within a surface, in pixels.
const SAME_SURFACE: f32 = 1.0;
/// The pixels on each side of the square in which views may differ in brightness from the centre.
const BRIGHTNESS_RADIUS: usize = 6;
/// The difference of grey levels at which a pixel has a quarter of its weight.
const OUTLIER: f32 = 6.0;
/// The weight of smoothness: the square of the slope, in grey levels per pixel of disparity, at which images count as much.
const STIFFNESS: f32 = 9.0;
/// The longest step of an iteration, in pixels of the longest baseline.
const MOST_STEP: f32 = 0.375;
/// The longest way of all iterations, in pixels of the longest baseline.
const MOST_SHIFT: f32 = 0.5;

/// A sub-pixel step after any method: disparities move by up to half a pixel to where the grey values of all views fit those of
/// the centre best (Lucas and Kanade 1981).
///
/// Each of three iterations linearises the views at the present matches, which lie between their pixels on a cubic spline:
///
/// 1. The residual of a pixel in a view is its grey level minus that of its match, less the mean of that difference
///    over the 13 x 13 pixels around it whose matches the view sees, so that views may differ in brightness. The
///    slope is the derivative of the match's grey level with respect to disparity, by the mean of the gradients at
///    the pixel and at its match (Malis 2004). A view at a longer baseline has a steeper one.
/// 2. A residual `r` has the weight `1 / (1 + (r / 6)^2)^2`: occlusions hardly count.
/// 3. Over a Gaussian window of 7 x 7 pixels, with a standard deviation of 1.5 pixels and weights of 1 in all, the
///    step is the sum of weight, slope and residual over the sum of weight and squared slope. Only pixels of the same
///    surface count, whose disparities differ by at most a pixel.
/// 4. Where there is no texture, disparities move to the mean of those in the window (Bruhn, Weickert and Schnörr
///    2005): both sums have a term for it, which counts as a slope of three grey levels per pixel.
///
/// A step is at most 3/8 pixel, and all together half a pixel, both in pixels of the longest baseline. Disparities do
/// not leave the search range. Invalid pixels stay invalid and never count. The result has the same bits with any
/// number of threads and on any processor.
///
/// It takes about 50 bytes for each pixel, and 8 more for each view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LucasKanade;

impl LucasKanade {
    /// The name on command lines.
    pub const NAME: &str = "lucas-kanade";

    /// The map with sharpened disparities, which stay in `range`, in pixels. The disparities are those of the centre of `frames`.
    /// Computed on the threads of the current pool.
    ///
    /// # Panics
    /// If a view is missing.
    pub fn apply(self, map: &DisparityMap, frames: &Frames, views: Views, range: RangeInclusive<i16>) -> DisparityMap {
        let start: Vec<f32> = map.pixels().iter().map(|d| d.map_or(f32::NAN, f32::from)).collect();
        let scene = Scene::new(frames, views);
        let mut disparities = start.clone();
        for _ in 0..ITERATIONS {
            disparities = scene.moved(&disparities);
        }
        let (least, most) = (f32::from(*range.start()), f32::from(*range.end()));
        let limit = MOST_SHIFT / scene.longest;
        let pixels = disparities.into_iter().zip(&start).map(|(d, &start)| {
            if start.is_nan() {
                return None;
            }
            // What is outside the range already may stay where it is.
            let d = d.clamp(start - limit, start + limit).clamp(least.min(start), most.max(start));
            Disparity::from_bits((d * Disparity::STEPS as f32).round() as i16)
        });
        DisparityMap::new(map.width(), map.height(), pixels.collect())
    }
}

/// The images.
struct Scene {
    width: usize,
    height: usize,
    center: Vec<f32>,
    /// The gradients of the centre's grey levels, to the right and down.
    gradients: Vec<[f32; 2]>,
    views: Vec<(View, InterpolatedImage)>,
    /// The longest baseline, as a multiple of the shortest.
    longest: f32,
    /// The weights of the window along a line.
    window: [f32; 2 * RADIUS + 1],
}

/// The differences between the centre's pixels and their matches in a view.
struct Differences {
    /// The centre's grey level minus that of the match, 0 if the view does not see it.
    residuals: Vec<f32>,
    /// The derivative of the match's grey level by the disparity, 0 if the view does not see it.
    slopes: Vec<f32>,
    /// The sum of the residuals of [`BRIGHTNESS_RADIUS`] pixels to both sides, and the number of their matches that the view
    /// sees.
    sums: Vec<f32>,
    counts: Vec<f32>,
}

/// A linear equation for the step of each pixel.
struct Equations {
    /// Weight, slope and residual, summed over the views.
    pulls: Vec<f32>,
    /// Weight and squared slope, summed over the views.
    squares: Vec<f32>,
}

impl Scene {
    fn new(frames: &Frames, views: Views) -> Scene {
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        let [width, height] = frames.size();
        let center = image(Frame::Center);
        let spline = InterpolatedImage::new(center);
        let gradient = |i: usize| {
            let [_, right, down] = spline.with_gradient([i % width, i / width].map(|at| at as f64));
            [right as f32, down as f32]
        };
        let reach = |view: View| view.right().unsigned_abs().max(view.down().unsigned_abs());
        let falloff = |k: usize| (-(k.abs_diff(RADIUS).pow(2) as f64) / (2.0 * SIGMA * SIGMA)).exp();
        let total: f64 = (0..2 * RADIUS + 1).map(falloff).sum();
        Scene {
            width,
            height,
            center: center.as_raw().iter().map(|&sample| f32::from(sample)).collect(),
            gradients: (0..width * height).into_par_iter().map(gradient).collect(),
            views: views.iter().map(|view| (view, InterpolatedImage::new(image(Frame::View(view))))).collect(),
            longest: views.iter().map(reach).max().unwrap_or(1).into(),
            window: std::array::from_fn(|k| (falloff(k) / total) as f32),
        }
    }

    /// The disparities after a step.
    fn moved(&self, disparities: &[f32]) -> Vec<f32> {
        let zeros = || vec![0.0; disparities.len()];
        let mut equations = Equations { pulls: zeros(), squares: zeros() };
        for (view, image) in &self.views {
            self.add(&self.differences(*view, image, disparities), &mut equations);
        }
        let mut moved = disparities.to_vec();
        moved.par_chunks_exact_mut(self.width).enumerate().for_each_init(
            || WindowSums::new(self.width),
            |sums, (v, moved)| {
                self.sum_window(v, disparities, &equations, sums);
                let limit = MOST_STEP / self.longest;
                let sums = sums.pulls.iter().zip(&sums.squares).zip(sums.gaps.iter().zip(&sums.weights));
                for (d, ((pull, square), (gap, weight))) in moved.iter_mut().zip(sums) {
                    // The pixel itself is in the window, so that the weight is not 0 unless it is invalid.
                    let step = (pull + STIFFNESS * (gap / weight)) / (square + STIFFNESS);
                    *d += step.clamp(-limit, limit);
                }
            },
        );
        moved
    }

    /// Computes the differences between the centre's pixels and their matches in a view.
    fn differences(&self, view: View, image: &InterpolatedImage, disparities: &[f32]) -> Differences {
        let zeros = || vec![0.0; disparities.len()];
        let Scene { width, height, .. } = *self;
        let mut differences = Differences { residuals: zeros(), slopes: zeros(), sums: zeros(), counts: zeros() };
        let Differences { residuals, slopes, sums, counts } = &mut differences;
        let [i, j] = [view.right(), view.down()].map(f32::from);
        let rows = residuals.par_chunks_exact_mut(width).zip(slopes.par_chunks_exact_mut(width));
        let rows = rows.zip(sums.par_chunks_exact_mut(width).zip(counts.par_chunks_exact_mut(width))).enumerate();
        rows.for_each_init(
            || vec![0.0; width],
            |seen, (v, ((residuals, slopes), (sums, counts)))| {
                for u in 0..width {
                    let at = v * width + u;
                    let (x, y) = (u as f32 - i * disparities[at], v as f32 - j * disparities[at]);
                    // Not where the disparity is invalid, which is NaN.
                    let is_seen = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f32 && y <= (height - 1) as f32;
                    (seen[u], residuals[u], slopes[u]) = (0.0, 0.0, 0.0);
                    if is_seen {
                        let [gray, right, down] = image.with_gradient([x.into(), y.into()]).map(|value| value as f32);
                        let [center_right, center_down] = self.gradients[at];
                        seen[u] = 1.0;
                        residuals[u] = self.center[at] - gray;
                        slopes[u] = -(i * (right + center_right) + j * (down + center_down)) / 2.0;
                    }
                }
                row_sums(residuals, sums);
                row_sums(seen, counts);
            },
        );
        differences
    }

    /// Adds the equations of a view.
    fn add(&self, differences: &Differences, equations: &mut Equations) {
        let Differences { residuals, slopes, sums, counts } = differences;
        let Scene { width, height, .. } = *self;
        let rows = equations.pulls.par_chunks_exact_mut(width).zip(equations.squares.par_chunks_exact_mut(width));
        rows.enumerate().for_each_init(
            || [vec![0.0; width], vec![0.0; width]],
            |[sum, count], (v, (pulls, squares))| {
                sum.fill(0.0);
                count.fill(0.0);
                for y in v.saturating_sub(BRIGHTNESS_RADIUS)..height.min(v + BRIGHTNESS_RADIUS + 1) {
                    add_row(sum, &sums[y * width..][..width]);
                    add_row(count, &counts[y * width..][..width]);
                }
                let [residuals, slopes] = [residuals, slopes].map(|plane| &plane[v * width..][..width]);
                let differences = residuals.iter().zip(slopes).zip(sum.iter().zip(&*count));
                for ((pull, square), ((residual, slope), (sum, count))) in pulls.iter_mut().zip(squares).zip(differences) {
                    // Where no match is seen, the slope is 0.
                    let residual = residual - sum / count.max(1.0);
                    let ratio = residual / OUTLIER;
                    let root = 1.0 / (1.0 + ratio * ratio);
                    let weighted = root * root * slope;
                    *pull += weighted * residual;
                    *square += weighted * slope;
                }
            },
        );
    }

    /// Sums over the windows of row `v`, of pixels of the same surface.
    fn sum_window(&self, v: usize, disparities: &[f32], equations: &Equations, sums: &mut WindowSums) {
        let Scene { width, height, .. } = *self;
        sums.clear();
        let here = &disparities[v * width..][..width];
        for y in v.saturating_sub(RADIUS)..height.min(v + RADIUS + 1) {
            let row_weight = self.window[y + RADIUS - v];
            let row = y * width..(y + 1) * width;
            let there = [&disparities[row.clone()], &equations.pulls[row.clone()], &equations.squares[row]];
            for (k, weight) in self.window.into_iter().enumerate() {
                // Columns from `first` on, and those that are `k - RADIUS` further to the right.
                let (first, shifted) = (RADIUS.saturating_sub(k), k.saturating_sub(RADIUS));
                let Some(length) = width.checked_sub(first + shifted) else { continue };
                sums.add(row_weight * weight, first, &here[first..][..length], there.map(|row| &row[shifted..][..length]));
            }
        }
    }
}

/// Sums over the windows of the pixels of a row.
struct WindowSums {
    pulls: Vec<f32>,
    squares: Vec<f32>,
    /// The differences between the disparities of the surface and that of the pixel.
    gaps: Vec<f32>,
    weights: Vec<f32>,
}

impl WindowSums {
    fn new(width: usize) -> WindowSums {
        let zeros = || vec![0.0; width];
        WindowSums { pulls: zeros(), squares: zeros(), gaps: zeros(), weights: zeros() }
    }

    fn clear(&mut self) {
        [&mut self.pulls, &mut self.squares, &mut self.gaps, &mut self.weights].into_iter().for_each(|sums| sums.fill(0.0));
    }

    /// Adds a pixel of each window of the columns from `first` on: `here` are their disparities, and `there` the
    /// disparities, pulls and squares of the pixels to add.
    fn add(&mut self, weight: f32, first: usize, here: &[f32], [there, pulls, squares]: [&[f32]; 3]) {
        let length = here.len();
        let (sums_of_pulls, sums_of_squares) = (&mut self.pulls[first..][..length], &mut self.squares[first..][..length]);
        let (sums_of_gaps, weights) = (&mut self.gaps[first..][..length], &mut self.weights[first..][..length]);
        let (there, pulls, squares) = (&there[..length], &pulls[..length], &squares[..length]);
        for u in 0..length {
            let gap = there[u] - here[u];
            let is_same = gap.abs() <= SAME_SURFACE;
            let weight = if is_same { weight } else { 0.0 };
            let gap = if is_same { gap } else { 0.0 };
            sums_of_pulls[u] += weight * pulls[u];
            sums_of_squares[u] += weight * squares[u];
            sums_of_gaps[u] += weight * gap;
            weights[u] += weight;
        }
    }
}

fn add_row(sums: &mut [f32], row: &[f32]) {
    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
}

/// The sums over [`BRIGHTNESS_RADIUS`] values to both sides of each of a row.
fn row_sums(row: &[f32], sums: &mut [f32]) {
    let entering = row.iter().skip(BRIGHTNESS_RADIUS).copied().chain(iter::repeat(0.0));
    let leaving = iter::repeat_n(0.0, BRIGHTNESS_RADIUS + 1).chain(row.iter().copied());
    let mut sum: f64 = row.iter().take(BRIGHTNESS_RADIUS).copied().map(f64::from).sum();
    for (to, (entering, leaving)) in sums.iter_mut().zip(entering.zip(leaving)) {
        sum += f64::from(entering) - f64::from(leaving);
        *to = sum as f32;
    }
}
