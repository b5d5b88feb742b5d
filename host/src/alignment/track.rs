//! Tracking the blocks of the centre in one view.

use image::GrayImage;
use multiscopic_core::{Params, View};
use rayon::prelude::*;

use super::{
    coarse_shift::coarse_shift,
    direction::Direction,
    interpolated::InterpolatedImage,
    normal_equations::{BLOCK, NormalEquations},
};
use crate::{
    error::{Error, Result},
    stereo::Engine,
};

/// The approximate maximum number of blocks.
const MAX_BLOCKS: usize = 5000;
/// The minimum number of blocks for an estimate.
const MIN_BLOCKS: usize = 30;
/// The maximum number of iterations.
const MAX_ITERATIONS: usize = 8;
/// The root mean square difference of grey values above which a block loses weight (Huber, 1964).
const HUBER: f64 = 3.0;

/// The alignment of one view, and where it shows the blocks of the centre.
pub struct Track {
    /// The shift across the baseline, in pixels.
    pub across: f64,
    /// The brightness relative to the centre.
    pub gain: f64,
    /// The disparity of each block that was found. The blocks are the same for all views of a capture.
    pub disparities: Vec<Option<f64>>,
}

impl Track {
    /// Tracks the blocks of `center` in `neighbor`, starting from block matching with `params`.
    ///
    /// # Errors
    /// If the two images have too little texture in common, or `params` are for images of another size.
    pub fn new([center, neighbor]: [&GrayImage; 2], view: View, params: &Params, engine: &Engine) -> Result<Track> {
        let mut gain = mean(neighbor) / mean(center).max(1.0);
        let (across, map) = coarse_shift([center, neighbor], view, params, engine, gain)?;
        let mut across = f64::from(across);
        let images = [center, neighbor].map(InterpolatedImage);
        let corners: Vec<[usize; 2]> = block_corners([params.width(), params.height()]).collect();
        let mut disparities: Vec<Option<f64>> =
            corners.iter().map(|&[u, v]| map.get(u + BLOCK / 2, v + BLOCK / 2).map(|d| f64::from(d.to_fixed()))).collect();
        let direction @ Direction { step, .. } = Direction::of(view);
        let range = f64::from(params.min_disparity()) - 1.0..=f64::from(params.max_disparity()) + 1.0;
        for iteration in 1..=MAX_ITERATIONS {
            let blocks: Vec<Option<NormalEquations>> = corners
                .par_iter()
                .zip(&disparities)
                .map(|(&corner, disparity)| {
                    NormalEquations::of_block(&images, corner, direction, [step * (*disparity)?, across], gain)
                })
                .collect();
            let mut sum = NormalEquations::default();
            for block in blocks.iter().flatten() {
                sum.add(block, (HUBER / block.difference.max(HUBER)).powi(2));
            }
            let count = blocks.iter().flatten().count();
            let Some([shift, brightness]) = sum.solve().filter(|_| count >= MIN_BLOCKS) else {
                return Err(Error::Usage(format!(
                    "the {view} view has {count} textured blocks of {BLOCK}x{BLOCK} pixels in common with the centre, and alignment needs \
                     {MIN_BLOCKS}: check the images and the range of disparities"
                )));
            };
            across += shift;
            gain += brightness;
            for (disparity, block) in disparities.iter_mut().zip(&blocks) {
                *disparity = disparity
                    .zip(*block)
                    .map(|(disparity, block)| disparity + block.position([shift, brightness]) / step)
                    // A block that leaves the search range was matched wrongly.
                    .filter(|disparity| range.contains(disparity));
            }
            if iteration == MAX_ITERATIONS || shift.abs() < 1e-4 && brightness.abs() < 1e-5 {
                let is_good = |block: &Option<NormalEquations>| block.is_some_and(|block| block.difference < HUBER);
                disparities
                    .iter_mut()
                    .zip(&blocks)
                    .for_each(|(disparity, block)| *disparity = disparity.filter(|_| is_good(block)));
                break;
            }
        }
        Ok(Track { across, gain, disparities })
    }
}

/// The mean grey value.
fn mean(image: &GrayImage) -> f64 {
    image.as_raw().iter().copied().map(f64::from).sum::<f64>() / image.as_raw().len() as f64
}

/// The top left corners of all blocks, as columns and rows.
fn block_corners([width, height]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let step = BLOCK.max((width * height / MAX_BLOCKS).isqrt());
    // Gradients read one pixel beyond a block, interpolation one more.
    let starts = move |size: usize| (2..size.saturating_sub(BLOCK + 1).max(2)).step_by(step);
    starts(height).flat_map(move |v| starts(width).map(move |u| [u, v]))
}
