//! Sub-pixel disparities by the gradients of images.

use std::{iter, ops::RangeInclusive};

use multiscopic_core::{Frame, View, Views};
use rayon::prelude::*;

use crate::images::{DisparityMap, Frames, InterpolatedImage, Raster, nearest_disparity};

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
/// The sum of weights below which there is no mean.
const LEAST_WEIGHT: f32 = 1e-9;
/// The weight of smoothness: the square of the slope, in grey levels per pixel of disparity, at which images count as much.
const STIFFNESS: f32 = 9.0;
/// The energy of residuals and of slopes, in squared grey levels, below which [`Fit`] trusts neither.
const LEAST_ENERGY: f32 = 1.0;
/// The slope, in grey levels per pixel, below which a pixel tells nothing about the noise of [`Fit`].
const LEAST_SLOPE: f32 = 0.01;
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
///    over the 13 x 13 pixels around it whose matches the view sees, so that views may differ in brightness. The mean is
///    taken twice, the second time with the weights of 2 by the first. The slope is the derivative of the match's grey
///    level with respect to disparity, by the mean of the gradients at the pixel and at its match (Malis 2004). A view at
///    a longer baseline has a steeper one.
/// 2. A residual `r` has the weight `1 / (1 + (r / 6)^2)^2`: occlusions hardly count.
/// 3. Over a Gaussian window of 7 x 7 pixels, with a standard deviation of 1.5 pixels and weights of 1 in all, the
///    step is the sum of weight, slope and residual over the sum of weight and squared slope. Only pixels of the same
///    surface count, whose disparities differ by at most a pixel.
/// 4. Where there is no texture, disparities move to the mean of those in the window (Bruhn, Weickert and Schnörr
///    2005): both sums have a term for it, which counts as a slope of three grey levels per pixel.
///
/// A view does not see a match that is outside its image, or hidden: one of the 3 x 3 pixels around it is the nearest to the
/// match of a pixel whose disparity, before the first iteration, is greater by more than a pixel.
///
/// A step is at most 3/8 pixel, and all together half a pixel, both in pixels of the longest baseline. Disparities do
/// not leave the search range. Invalid pixels stay invalid and never count. The result has the same bits with any
/// number of threads and on any processor.
///
/// It takes about 60 bytes for each pixel, and 9 more for each view.
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
        let scene = Scene::new(frames, views, &start);
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
            nearest_disparity(d)
        });
        DisparityMap::new(map.width(), map.height(), pixels.collect())
    }

    /// Returns the fit of the disparities of the centre of `frames` to the images, and the misalignment of the views in pixels:
    /// the root mean square of the shifts, across their baselines and for several views also along them, that explain the
    /// residuals in each of 4 x 4 parts of the image. Only pixels that are `sure` count for it. Computed on the threads of the
    /// current pool.
    ///
    /// # Panics
    /// If a view is missing.
    pub fn fit(self, map: &DisparityMap, sure: impl Fn(usize) -> bool, frames: &Frames, views: Views) -> (Raster<Fit>, f32) {
        let disparities: Vec<f32> = map.pixels().iter().map(|d| d.map_or(f32::NAN, f32::from)).collect();
        let scene = Scene::new(frames, views, &disparities);
        let zeros = || vec![0.0; disparities.len()];
        let equations = || Equations { pulls: zeros(), squares: zeros() };
        let (mut steps, mut noise) = (equations(), equations());
        let mut misalignment = [0.0; 2];
        for neighbor in &scene.neighbors {
            let mut differences = scene.differences(neighbor, &disparities);
            let mut own = equations();
            scene.add(&differences, &mut own, pull);
            if scene.neighbors.len() > 1 {
                scene.add_shifts(&own, neighbor.view, &sure, &mut misalignment);
            }
            add_row(&mut steps.pulls, &own.pulls);
            add_row(&mut steps.squares, &own.squares);
            scene.add(&differences, &mut noise, |weight, residual, slope| match slope.abs() < LEAST_SLOPE {
                true => [0.0; 2],
                false => [weight.sqrt() * residual * residual, 1.0],
            });
            scene.slopes_across(neighbor, &disparities, &mut differences.slopes);
            let mut across = equations();
            scene.add(&differences, &mut across, pull);
            scene.add_shifts(&across, neighbor.view, &sure, &mut misalignment);
        }
        let mut fits = Raster::filled(scene.width, scene.height, Fit::default());
        fits.pixels_mut().par_chunks_exact_mut(scene.width).enumerate().for_each_init(
            || [WindowSums::new(scene.width), WindowSums::new(scene.width)],
            |[sums, noises], (v, fits)| {
                scene.sum_window(v, &disparities, &steps, sums);
                scene.sum_window(v, &disparities, &noise, noises);
                for (u, fit) in fits.iter_mut().enumerate() {
                    let (square, weight) = (sums.squares[u], sums.weights[u]);
                    // There is no weight where the pixel is invalid.
                    let roughness = if weight > 0.0 { sums.gaps[u] / weight } else { 0.0 };
                    let energy = (noises.pulls[u] + LEAST_ENERGY) / (noises.squares[u] + LEAST_ENERGY);
                    *fit = Fit {
                        step: (sums.pulls[u] + STIFFNESS * roughness) / (square + STIFFNESS),
                        noise: (energy / (square + LEAST_ENERGY)).sqrt(),
                        roughness,
                        edge: 1.0 - weight,
                    };
                }
            },
        );
        let [shifts, weights] = misalignment;
        (fits, if weights > 0.0 { (shifts / weights).sqrt() as f32 } else { 0.0 })
    }
}

/// The fit of a disparity to the images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// The step that [`LucasKanade`] would take, in pixels.
    pub step: f32,
    /// The deviation of a step of the noise that the residuals show, over one pixel of the window, in pixels: the root of their
    /// mean square, and at least of one grey level, over the root of the squared slopes.
    pub noise: f32,
    /// The mean difference of the window's disparities from this one, in pixels.
    pub roughness: f32,
    /// The share of the window, from 0 to 1, that belongs to other surfaces, has no disparity or is beyond the image.
    pub edge: f32,
}

/// The images.
struct Scene {
    width: usize,
    height: usize,
    center: Vec<f32>,
    /// The gradients of the centre's grey levels, to the right and down.
    gradients: Vec<[f32; 2]>,
    neighbors: Vec<Neighbor>,
    /// The longest baseline, as a multiple of the shortest.
    longest: f32,
    /// The weights of the window along a line.
    window: [f32; 2 * RADIUS + 1],
}

/// A view of the scene.
struct Neighbor {
    view: View,
    image: InterpolatedImage,
    /// True for the centre's pixels that something nearer hides from the view.
    is_hidden: Vec<bool>,
}

/// The differences between the centre's pixels and their matches in a view.
struct Differences {
    /// The centre's grey level minus that of the match, less the mean around; of no importance if the view does not see it.
    residuals: Vec<f32>,
    /// The derivative of the match's grey level by the disparity, 0 if the view does not see it.
    slopes: Vec<f32>,
}

/// A linear equation for the step of each pixel.
struct Equations {
    /// Weight, slope and residual, summed over the views.
    pulls: Vec<f32>,
    /// Weight and squared slope, summed over the views.
    squares: Vec<f32>,
}

impl Scene {
    /// The scene with these disparities, by which views see it.
    fn new(frames: &Frames, views: Views, disparities: &[f32]) -> Scene {
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        let size = frames.size();
        let [width, height] = size;
        let center = image(Frame::Center);
        let spline = InterpolatedImage::new(center);
        let gradient = |i: usize| {
            let [_, right, down] = spline.with_gradient([i % width, i / width].map(|at| at as f64));
            [right as f32, down as f32]
        };
        let reach = |view: View| view.right().unsigned_abs().max(view.down().unsigned_abs());
        let falloff = |k: usize| (-(k.abs_diff(RADIUS).pow(2) as f64) / (2.0 * SIGMA * SIGMA)).exp();
        let total: f64 = (0..2 * RADIUS + 1).map(falloff).sum();
        let neighbor = |view: View| {
            let image = InterpolatedImage::new(image(Frame::View(view)));
            Neighbor { view, image, is_hidden: hidden(view, size, disparities) }
        };
        Scene {
            width,
            height,
            center: center.as_raw().iter().map(|&sample| f32::from(sample)).collect(),
            gradients: (0..width * height).into_par_iter().map(gradient).collect(),
            neighbors: views.iter().map(neighbor).collect(),
            longest: views.iter().map(reach).max().unwrap_or(1).into(),
            window: std::array::from_fn(|k| (falloff(k) / total) as f32),
        }
    }

    /// The disparities after a step.
    fn moved(&self, disparities: &[f32]) -> Vec<f32> {
        let zeros = || vec![0.0; disparities.len()];
        let mut equations = Equations { pulls: zeros(), squares: zeros() };
        for neighbor in &self.neighbors {
            let differences = self.differences(neighbor, disparities);
            self.add(&differences, &mut equations, pull);
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

    /// The differences between the centre's pixels and their matches in a view.
    fn differences(&self, neighbor: &Neighbor, disparities: &[f32]) -> Differences {
        let Scene { width, .. } = *self;
        let [mut residuals, mut slopes, mut weights, mut means] = [(); 4].map(|()| vec![0.0; disparities.len()]);
        let [i, j] = [neighbor.view.right(), neighbor.view.down()].map(f32::from);
        let rows = residuals.par_chunks_exact_mut(width).zip(slopes.par_chunks_exact_mut(width));
        rows.zip(weights.par_chunks_exact_mut(width)).enumerate().for_each(|(v, ((residuals, slopes), weights))| {
            for u in 0..width {
                let at = v * width + u;
                let Some([x, y]) = self.seen_match(neighbor, at, disparities[at]) else { continue };
                let [gray, right, down] = neighbor.image.with_gradient([x.into(), y.into()]).map(|value| value as f32);
                let [center_right, center_down] = self.gradients[at];
                (residuals[u], weights[u]) = (self.center[at] - gray, 1.0);
                slopes[u] = -(i * (right + center_right) + j * (down + center_down)) / 2.0;
            }
        });
        // What differs for another reason than the brightness of the view hardly counts the second time.
        self.means_around(&residuals, &weights, &mut means);
        let inliers = weights.par_iter_mut().zip(&residuals).zip(&means);
        inliers.for_each(|((weight, residual), mean)| *weight *= inlier_weight(residual - mean));
        self.means_around(&residuals, &weights, &mut means);
        residuals.par_iter_mut().zip(&means).for_each(|(residual, mean)| *residual -= mean);
        Differences { residuals, slopes }
    }

    /// Computes the weighted means of values over the square of [`BRIGHTNESS_RADIUS`] around each pixel; of no importance where
    /// there is no weight.
    fn means_around(&self, values: &[f32], weights: &[f32], means: &mut [f32]) {
        let Scene { width, height, .. } = *self;
        let [mut sums, mut counts] = [(); 2].map(|()| vec![0.0; values.len()]);
        let rows = sums.par_chunks_exact_mut(width).zip(counts.par_chunks_exact_mut(width));
        let given = values.par_chunks_exact(width).zip(weights.par_chunks_exact(width));
        rows.zip(given).for_each_init(
            || vec![0.0; width],
            |weighted, ((sums, counts), (values, weights))| {
                weighted.iter_mut().zip(values.iter().zip(weights)).for_each(|(to, (value, weight))| *to = value * weight);
                row_sums(weighted, sums);
                row_sums(weights, counts);
            },
        );
        means.par_chunks_exact_mut(width).enumerate().for_each_init(
            || vec![0.0; width],
            |count, (v, means)| {
                count.fill(0.0);
                means.fill(0.0);
                for y in v.saturating_sub(BRIGHTNESS_RADIUS)..height.min(v + BRIGHTNESS_RADIUS + 1) {
                    add_row(means, &sums[y * width..][..width]);
                    add_row(count, &counts[y * width..][..width]);
                }
                means.iter_mut().zip(&*count).for_each(|(mean, count)| *mean /= count.max(LEAST_WEIGHT));
            },
        );
    }

    /// The match of a pixel, by its place row by row, in a view that sees it.
    fn seen_match(&self, neighbor: &Neighbor, at: usize, disparity: f32) -> Option<[f32; 2]> {
        let Neighbor { view, is_hidden, .. } = neighbor;
        if is_hidden[at] { None } else { match_in(*view, [self.width, self.height], at, disparity) }
    }

    /// Replaces slopes by the derivatives of the matches' grey levels across the baseline of a view, each over the length of
    /// the baseline as those along it are; 0 where the view does not see the match.
    fn slopes_across(&self, neighbor: &Neighbor, disparities: &[f32], slopes: &mut [f32]) {
        let [i, j] = [neighbor.view.right(), neighbor.view.down()].map(f32::from);
        slopes.par_chunks_exact_mut(self.width).enumerate().for_each(|(v, slopes)| {
            for (u, slope) in slopes.iter_mut().enumerate() {
                let at = v * self.width + u;
                let Some([x, y]) = self.seen_match(neighbor, at, disparities[at]) else { continue };
                let [_, right, down] = neighbor.image.with_gradient([x.into(), y.into()]).map(|value| value as f32);
                let [center_right, center_down] = self.gradients[at];
                *slope = (j * (right + center_right) - i * (down + center_down)) / 2.0;
            }
        });
    }

    /// Adds the squares of the shifts of a view in the parts of the image, each weighted by its squared slopes, and the
    /// weights.
    fn add_shifts(&self, of_view: &Equations, view: View, sure: impl Fn(usize) -> bool, [shifts, weights]: &mut [f64; 2]) {
        const PARTS: usize = 4;
        let part = |at: usize| {
            let (u, v) = (at % self.width, at / self.width);
            v * PARTS / self.height * PARTS + u * PARTS / self.width
        };
        let mut sums = [[0.0f64; 2]; PARTS * PARTS];
        for (at, (pull, square)) in of_view.pulls.iter().zip(&of_view.squares).enumerate().filter(|(at, _)| sure(*at)) {
            let [pulls, squares] = &mut sums[part(at)];
            (*pulls, *squares) = (*pulls + f64::from(*pull), *squares + f64::from(*square));
        }
        let length = f64::from(view.right().unsigned_abs().max(view.down().unsigned_abs()));
        for [pull, square] in sums.into_iter().filter(|[_, square]| *square > 0.0) {
            // A view at a longer baseline has a steeper slope, and its shift is in pixels of the shortest.
            *shifts += pull * pull / square / (length * length);
            *weights += square / (length * length);
        }
    }

    /// Adds the equations of a view: the `terms` of weight, residual and slope.
    fn add(&self, differences: &Differences, equations: &mut Equations, terms: impl Fn(f32, f32, f32) -> [f32; 2] + Sync) {
        let Differences { residuals, slopes } = differences;
        let sums = equations.pulls.par_iter_mut().zip(&mut equations.squares);
        sums.zip(residuals.par_iter().zip(slopes)).for_each(|((pull, square), (&residual, &slope))| {
            let [first, second] = terms(inlier_weight(residual), residual, slope);
            *pull += first;
            *square += second;
        });
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

/// The centre's pixels, row by row, that something nearer hides from a view: see [`LucasKanade`].
fn hidden(view: View, [width, height]: [usize; 2], disparities: &[f32]) -> Vec<bool> {
    let nearest_pixel = |(at, &disparity): (usize, &f32)| {
        let [x, y] = match_in(view, [width, height], at, disparity)?.map(|at| (at + 0.5) as usize);
        Some((x, y, disparity))
    };
    let mut greatest = vec![f32::NEG_INFINITY; width * height];
    for (x, y, disparity) in disparities.iter().enumerate().filter_map(nearest_pixel) {
        let there = &mut greatest[y * width + x];
        *there = disparity.max(*there);
    }
    let is_hidden = |(x, y, disparity): (usize, usize, f32)| {
        let mut rows = greatest.chunks_exact(width).take(y + 2).skip(y.saturating_sub(1));
        let columns = x.saturating_sub(1)..width.min(x + 2);
        rows.any(|row| row[columns.clone()].iter().any(|other| other - disparity > SAME_SURFACE))
    };
    disparities.par_iter().enumerate().map(|pixel| nearest_pixel(pixel).is_some_and(is_hidden)).collect()
}

/// The match of a pixel, by its place row by row, if it is in the image of a view.
fn match_in(view: View, [width, height]: [usize; 2], at: usize, disparity: f32) -> Option<[f32; 2]> {
    let (u, v) = (at % width, at / width);
    let (x, y) = (u as f32 - f32::from(view.right()) * disparity, v as f32 - f32::from(view.down()) * disparity);
    // Not where the disparity is invalid, which is NaN.
    let is_inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f32 && y <= (height - 1) as f32;
    is_inside.then_some([x, y])
}

/// The weight of a residual, by which occlusions hardly count.
fn inlier_weight(residual: f32) -> f32 {
    let ratio = residual / OUTLIER;
    let root = 1.0 / (1.0 + ratio * ratio);
    root * root
}

/// The terms of the equations for a step: weight, slope and residual, and weight and squared slope.
fn pull(weight: f32, residual: f32, slope: f32) -> [f32; 2] {
    [weight * slope * residual, weight * slope * slope]
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
