//! How far the views of a capture are from where they should be: estimated from the images, and taken out of them.
//!
//! A camera that is moved by hand, by a cheap slide, or is not square to it, gives views that lie a little beside the baseline, one baseline
//! longer than another, one brighter than another. Matching searches along the baseline only, and compares grey values. What is estimated,
//! by view, is a shift across the baseline, a factor of brightness, and the length of the baseline in proportion to the others'.
//!
//! The whole pixels of the shift are those whose matches cost least. The rest is that of least squares over small blocks, like the optical flow
//! of Lucas and Kanade (1981), with unknowns in common for all blocks: the shift and the factor of brightness. Each block has one unknown
//! of its own, where along the baseline its match is, which is eliminated.

use image::GrayImage;
use multiscopic_core::{Frame, Fusion, Params, View, Views};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    stereo::Engine,
};

/// How many pixels a view may be shifted across its baseline.
pub const MAX_SHIFT: i32 = 5;

/// Sides of the blocks of least squares in pixels, and about how many there are of them at most.
const BLOCK: usize = 9;
const MAX_BLOCKS: usize = 5000;
/// Rounds of least squares.
const ROUNDS: usize = 8;
/// Differences of grey from which a block counts less, and the most that is counted at all.
const HUBER: f64 = 3.0;
const MOST_DIFFERENCE: f64 = 20.0;
/// The least that the grey values of a block change per pixel, root mean square.
const MIN_CONTRAST: f64 = 2.0;
/// The fewest blocks that make an estimate.
const MIN_BLOCKS: usize = 30;

/// What is off in a view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// How far the image of the view is shifted across the baseline, in pixels: down for a left or right view, to the right for a top or bottom
    /// view.
    pub across_px: f64,
    /// The length of the baseline in proportion to the mean of all views; 1 for a single view.
    pub baseline_scale: f64,
    /// How far that puts the greatest disparity of the search off, in pixels.
    pub baseline_px: f64,
    /// How much brighter the view is than the centre: the ratio of grey values.
    pub gain: f64,
    /// Of how many blocks of the image that is the estimate.
    pub blocks: usize,
}

/// What is off in each view of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    residuals: [Option<Residual>; View::ALL.len()],
}

impl Alignment {
    /// Estimates what is off in every view of `frames`, whose disparities are searched in the range of `params`.
    ///
    /// # Errors
    /// A view has too little texture in common with the centre.
    pub fn estimate(frames: &Frames, params: &Params, engine: &Engine) -> Result<Alignment> {
        let mut tracks = Vec::new();
        for view in frames.views().iter() {
            tracks.push((view, Track::of(frames, view, params, engine)?));
        }
        let scales = baseline_scales(&tracks.iter().map(|(_, track)| track).collect::<Vec<_>>());
        let mut residuals = [None; View::ALL.len()];
        for ((view, track), baseline_scale) in tracks.iter().zip(scales) {
            residuals[*view as usize] = Some(Residual {
                across_px: track.across,
                baseline_scale,
                baseline_px: (baseline_scale - 1.0) * f64::from(params.max_disparity()),
                gain: track.gain,
                blocks: track.blocks.iter().filter(|block| block.is_some()).count(),
            });
        }
        Ok(Alignment { residuals })
    }

    /// What is off in a view, if it was there.
    pub fn of(&self, view: View) -> Option<Residual> {
        self.residuals[view as usize]
    }

    /// The frames with shifts and brightness put right. The lengths of the baselines stay as they are.
    pub fn compensate(&self, frames: &Frames) -> Frames {
        let center = image(frames, Frame::Center).clone();
        frames.views().iter().fold(Frames::new(center), |compensated, view| {
            let neighbor = image(frames, Frame::View(view));
            let neighbor = match self.of(view) {
                Some(Residual { across_px, gain, .. }) => put_right(neighbor, view, across_px, gain),
                None => neighbor.clone(),
            };
            compensated.with(view, neighbor)
        })
    }
}

/// A pair for columns and rows as a pair for along the baseline of a view and across it.
fn along_and_across<T>([u, v]: [T; 2], view: View) -> [T; 2] {
    if view.is_horizontal() { [u, v] } else { [v, u] }
}

/// A view shifted back by `across_px` across its baseline, its grey values divided by `gain`.
fn put_right(image: &GrayImage, view: View, across_px: f64, gain: f64) -> GrayImage {
    let source = Plane::of(image, view);
    GrayImage::from_fn(image.width(), image.height(), |u, v| {
        let [along, across] = along_and_across([u, v], view).map(f64::from);
        let gray = source.at(along, across + across_px) / gain;
        image::Luma([gray.round().clamp(0.0, 255.0) as u8])
    })
}

/// A grey image by coordinates along the baseline of a view and across it.
struct Plane<'a> {
    pixels: &'a [u8],
    /// From a pixel to the next, along and across.
    strides: [usize; 2],
    /// Pixels along and across.
    size: [usize; 2],
}

impl Plane<'_> {
    fn of(image: &GrayImage, view: View) -> Plane<'_> {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let [strides, size] = [[1, width], [width, height]].map(|pair| along_and_across(pair, view));
        Plane { pixels: image.as_raw(), strides, size }
    }

    /// The pixel at whole coordinates, of the image continued beyond its borders.
    fn pixel(&self, along: isize, across: isize) -> f64 {
        let [along, across] = [(along, 0), (across, 1)].map(|(at, axis)| at.clamp(0, self.size[axis] as isize - 1) as usize);
        f64::from(self.pixels[along * self.strides[0] + across * self.strides[1]])
    }

    /// The grey value between pixels, by cubic convolution (Keys, 1981).
    fn at(&self, along: f64, across: f64) -> f64 {
        let ([u, v], [wu, wv]) = {
            let [(u, wu), (v, wv)] = [along, across].map(|at| (at.floor() as isize, cubic(at - at.floor())));
            ([u, v], [wu, wv])
        };
        let row = |v: isize| (-1..).zip(wu).map(|(i, w)| if w == 0.0 { 0.0 } else { w * self.pixel(u + i, v) }).sum::<f64>();
        (-1..).zip(wv).map(|(j, w)| if w == 0.0 { 0.0 } else { w * row(v + j) }).sum()
    }
}

/// The weights of four pixels for a place so far behind the second.
fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [(-t3 + 2.0 * t2 - t) / 2.0, (3.0 * t3 - 5.0 * t2 + 2.0) / 2.0, (-3.0 * t3 + 4.0 * t2 + t) / 2.0, (t3 - t2) / 2.0]
}

/// Where the blocks of the centre are found in a view.
struct Track {
    across: f64,
    gain: f64,
    /// The disparity of each block, if it was found, in the same order for each view.
    blocks: Vec<Option<f64>>,
}

/// What a block says of the unknowns that all have in common, once its own is eliminated.
#[derive(Clone, Copy, Default)]
struct Equations {
    /// Of the shift and the gain, symmetric.
    matrix: [[f64; 2]; 2],
    right: [f64; 2],
    /// To find the block's own unknown again: its square, its products with the others, and with the difference.
    own: [f64; 4],
    /// Root mean square of the differences.
    difference: f64,
}

impl Track {
    fn of(frames: &Frames, view: View, params: &Params, engine: &Engine) -> Result<Track> {
        let (center, neighbor) = (image(frames, Frame::Center), image(frames, Frame::View(view)));
        let mut gain = mean(neighbor) / mean(center).max(1.0);
        let (across, disparities) = whole_pixels(frames, view, params, engine, gain)?;
        let mut across = f64::from(across);
        let planes = [Plane::of(center, view), Plane::of(neighbor, view)];
        let corners: Vec<[usize; 2]> = corners(frames.size()).collect();
        let mut blocks: Vec<Option<f64>> = corners
            .iter()
            .map(|&[u, v]| disparities.get(u + BLOCK / 2, v + BLOCK / 2).map(|disparity| f64::from(disparity.to_fixed())))
            .collect();
        for round in 0..ROUNDS {
            let mut sum = Equations::default();
            let found: Vec<Option<Equations>> = corners
                .par_iter()
                .zip(&blocks)
                .map(|(&corner, disparity)| {
                    equations(&planes, along_and_across(corner, view), f64::from(view.sign()) * (*disparity)?, across, gain)
                })
                .collect();
            for equations in found.iter().flatten() {
                let weight = (HUBER / equations.difference.max(HUBER)).powi(2);
                for i in 0..2 {
                    sum.right[i] += weight * equations.right[i];
                    (0..2).for_each(|j| sum.matrix[i][j] += weight * equations.matrix[i][j]);
                }
            }
            let count = found.iter().flatten().count();
            let change = solve(sum.matrix, sum.right).filter(|_| count >= MIN_BLOCKS);
            let Some([shift, brightness]) = change else {
                return Err(Error::Usage(format!(
                    "the {} view has {count} textured blocks of {BLOCK}x{BLOCK} pixels in common with the centre, to align it takes {MIN_BLOCKS}: check \
                     the images and the range of disparities",
                    view.name()
                )));
            };
            across += shift;
            gain += brightness;
            for (disparity, equations) in blocks.iter_mut().zip(&found) {
                *disparity = disparity.zip(*equations).map(|(disparity, equations)| {
                    let [own, by_shift, by_gain, difference] = equations.own;
                    disparity + f64::from(view.sign()) * (difference - by_shift * shift - by_gain * brightness) / own
                });
            }
            // Blocks that go astray were matched wrongly.
            let range = f64::from(params.min_disparity()) - 1.0..=f64::from(params.max_disparity()) + 1.0;
            blocks.iter_mut().for_each(|block| *block = block.filter(|disparity| range.contains(disparity)));
            if round + 1 == ROUNDS || shift.abs() < 1e-4 && brightness.abs() < 1e-5 {
                let good = |equations: &Option<Equations>| equations.is_some_and(|equations| equations.difference < HUBER);
                blocks.iter_mut().zip(&found).for_each(|(block, found)| *block = block.filter(|_| good(found)));
                break;
            }
        }
        Ok(Track { across, gain, blocks })
    }
}

fn image(frames: &Frames, frame: Frame) -> &GrayImage {
    frames.get(frame).expect("it is one of the frames")
}

fn mean(image: &GrayImage) -> f64 {
    image.as_raw().iter().copied().map(f64::from).sum::<f64>() / image.as_raw().len() as f64
}

/// The corners of all blocks, in columns and rows.
fn corners([width, height]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let step = BLOCK.max((width * height / MAX_BLOCKS).isqrt());
    let starts = move |size: usize| (2..size.saturating_sub(BLOCK + 1).max(2)).step_by(step);
    starts(height).flat_map(move |v| starts(width).map(move |u| [u, v]))
}

/// The shift across the baseline in whole pixels whose matches differ least, and these matches.
fn whole_pixels(frames: &Frames, view: View, params: &Params, engine: &Engine, gain: f64) -> Result<(i32, DisparityMap)> {
    let neighbor = image(frames, Frame::View(view));
    let [width, height] = frames.size();
    let alone = Params::new(
        width as u16,
        height as u16,
        Views::NONE.with(view),
        Fusion::Min,
        params.min_disparity(),
        params.num_disparities() as u16,
        params.block_size() as u8,
    )?;
    let mut moved = Frames::new(image(frames, Frame::Center).clone());
    let mut best: Option<(f64, i32, DisparityMap)> = None;
    for shift in -MAX_SHIFT..=MAX_SHIFT {
        moved = moved.with(view, put_right(neighbor, view, shift.into(), gain));
        let disparities = engine.disparities(&moved, &alone, || ())?;
        let cost = difference(&moved, view, &disparities);
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, shift, disparities));
        }
    }
    let (_, shift, disparities) = best.expect("there is more than one shift");
    Ok((shift, disparities))
}

/// How much pixels differ from their matches in the mean; large differences are all the same.
fn difference(frames: &Frames, view: View, disparities: &DisparityMap) -> f64 {
    let planes = [Frame::Center, Frame::View(view)].map(|frame| Plane::of(image(frames, frame), view));
    let [width, height] = frames.size();
    let mut sum = 0.0;
    for (u, v) in (0..height).flat_map(|v| (0..width).map(move |u| (u, v))) {
        let [along, across] = along_and_across([u, v], view).map(|at| at as isize);
        sum += disparities.get(u, v).map_or(MOST_DIFFERENCE, |disparity| {
            let moved = along + view.sign() as isize * disparity.to_fixed().round().to_num::<isize>();
            (planes[0].pixel(along, across) - planes[1].pixel(moved, across)).abs().min(MOST_DIFFERENCE)
        });
    }
    sum
}

/// What the block at `corner`, along and across, says, if its match is `moved` along the baseline and `across` it; `None` without texture, or if
/// it is no match.
fn equations([center, neighbor]: &[Plane<'_>; 2], corner: [usize; 2], moved: f64, across: f64, gain: f64) -> Option<Equations> {
    let mut sums = [[0.0; 4]; 4];
    for (i, j) in (0..BLOCK).flat_map(|j| (0..BLOCK).map(move |i| (i, j))) {
        let (x, y) = ((corner[0] + i) as isize, (corner[1] + j) as isize);
        let (u, v) = (x as f64 + moved, y as f64 + across);
        let (gray, found) = (center.pixel(x, y), neighbor.at(u, v));
        // Whatever is brighter looks the same.
        if gray >= 254.0 || found >= 254.0 {
            return None;
        }
        // The mean of the slopes in both images leaves an error of the third order only.
        let slope = |before: f64, after: f64, before_center: f64, after_center: f64| {
            (after - before + gain * (after_center - before_center)) / 4.0
        };
        let along = slope(neighbor.at(u - 1.0, v), neighbor.at(u + 1.0, v), center.pixel(x - 1, y), center.pixel(x + 1, y));
        let down = slope(neighbor.at(u, v - 1.0), neighbor.at(u, v + 1.0), center.pixel(x, y - 1), center.pixel(x, y + 1));
        // found + along * own + down * shift = (gain + brightness) * gray
        let row = [along, down, -gray, gain * gray - found];
        for (sums, a) in sums.iter_mut().zip(row) {
            sums.iter_mut().zip(row).for_each(|(sum, b)| *sum += a * b);
        }
    }
    let count = (BLOCK * BLOCK) as f64;
    let [along, down, bright, differences] = sums;
    let difference = (differences[3] / count).sqrt();
    if along[0] < count * MIN_CONTRAST * MIN_CONTRAST || difference > MOST_DIFFERENCE {
        return None;
    }
    let without_own = |a: f64, with_a: f64, with_b: f64| a - with_a * with_b / along[0];
    Some(Equations {
        matrix: [
            [without_own(down[1], along[1], along[1]), without_own(down[2], along[1], along[2])],
            [without_own(down[2], along[1], along[2]), without_own(bright[2], along[2], along[2])],
        ],
        right: [without_own(down[3], along[1], along[3]), without_own(bright[3], along[2], along[3])],
        own: along,
        difference,
    })
}

/// The solution of two symmetric equations, if there is one.
fn solve([[a, b], [_, c]]: [[f64; 2]; 2], [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a * c - b * b;
    (determinant > 1e-9 * a * c && determinant.is_finite())
        .then(|| [(c * x - b * y) / determinant, (a * y - b * x) / determinant])
}

/// How long the baselines of the views are in proportion to their mean: by the disparities of blocks that all views have found.
fn baseline_scales(tracks: &[&Track]) -> Vec<f64> {
    let mut scales = vec![1.0; tracks.len()];
    let count = tracks.first().map_or(0, |track| track.blocks.len());
    let found: Vec<Vec<f64>> = (0..count).filter_map(|block| tracks.iter().map(|track| track.blocks[block]).collect()).collect();
    for _ in 0..20 {
        let mut sums = vec![[0.0; 2]; tracks.len()];
        for disparities in &found {
            let mut of_mean: Vec<f64> = disparities.iter().zip(&scales).map(|(disparity, scale)| disparity / scale).collect();
            of_mean.sort_unstable_by(f64::total_cmp);
            // Views that do not agree see different things, as at the edge of what is near.
            if of_mean[of_mean.len() - 1] - of_mean[0] > 1.0 + 0.1 * of_mean[0].abs() {
                continue;
            }
            let common = of_mean.iter().sum::<f64>() / of_mean.len() as f64;
            for (sums, disparity) in sums.iter_mut().zip(disparities) {
                *sums = [sums[0] + disparity * common, sums[1] + common * common];
            }
        }
        if sums.iter().any(|sums| sums[1] == 0.0) {
            return vec![1.0; tracks.len()];
        }
        scales = sums.iter().map(|[product, square]| product / square).collect();
        let mean = scales.iter().sum::<f64>() / scales.len() as f64;
        scales.iter_mut().for_each(|scale| *scale /= mean);
    }
    scales
}
