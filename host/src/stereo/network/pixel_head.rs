//! The end of the network: disparities of pixels by the outputs of its last layer.

use multiscopic_core::Disparity;
use rayon::prelude::*;

use super::{
    activations::Activations,
    block_disparities::BlockDisparities,
    exponentials::Exponentials,
    inputs::{BLOCK, Inputs},
    look::Look,
    operations::Operations,
    quantized_layer::{QuantizedLayer, Runs},
};
use crate::images::Raster;

/// The neighbours whose disparities are mixed: the pixel itself, then those around at distances of 1 and 3.
const NEIGHBORS: usize = 17;

/// What turns the outputs of the last layer into disparities and confidences.
///
/// The outputs of a pixel are scores, in sixteenths, by whose exponentials disparities are weighted in a mean:
///
/// | outputs | what they weight |
/// | --- | --- |
/// | 20 to 28 | the disparities of 3x3 blocks around: their mean is a third candidate |
/// | 17, 18, 19 | the disparities of both passes of semi-global matching, and that candidate: their mean is the pixel's choice |
/// | 0 to 16 | the choices of the pixel and of the neighbours |
///
/// Output 29 is a correction in steps of a disparity, and output 30 the logit of the confidence.
#[derive(Clone, Copy, Debug)]
pub struct PixelHead<'a> {
    /// What the network sees of the images.
    pub inputs: &'a Inputs,
    /// What the volume part of the network found.
    pub blocks: &'a BlockDisparities,
    /// The weights of scores.
    pub exponentials: &'a Exponentials,
    /// The confidences of logits from -128 on.
    pub confidences: &'a [u8; 256],
}

/// What is known of a pixel before the choices of its neighbours are.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    /// The pixel's own choice.
    choice: u16,
    correction: i16,
    /// How far the scores of the neighbours' choices are below the greatest.
    below: [u8; NEIGHBORS],
    confidence: u8,
}

impl PixelHead<'_> {
    /// The outputs of a pixel.
    pub const OUTPUTS: usize = 31;

    /// The disparities and confidences of all pixels. The layers compute the outputs of the upper and of the lower of
    /// two rows.
    pub fn look(&self, layers: &[QuantizedLayer; 2], input: &Activations, operations: Operations) -> Look {
        let [columns, rows] = self.inputs.blocks;
        let (width, height) = (BLOCK * columns, BLOCK * rows);
        let mut pixels = vec![Pixel::default(); width * height];
        pixels.par_chunks_exact_mut(width).enumerate().for_each_init(Vec::new, |outputs, (y, row)| {
            let layer = &layers[y % 2];
            outputs.resize(width / 2 * layer.padded_outputs(), 0);
            let runs = Runs { runs: [input.row(0, (y / 2) as isize)], stride: input.cell() };
            layer.row(operations.products, runs, outputs);
            let pairs = row.as_chunks_mut::<2>().0.iter_mut().zip(outputs.chunks_exact(layer.padded_outputs()));
            for (x, (pair, outputs)) in pairs.enumerate() {
                let (left, right) = outputs.split_at(Self::OUTPUTS);
                *pair = [self.pixel([2 * x, y], left), self.pixel([2 * x + 1, y], right)];
            }
        });

        let most = Disparity::STEPS * (self.inputs.num_disparities as i32 - 1);
        let [across, down] = [self.inputs.colors.width(), self.inputs.colors.height()];
        let mut disparities = Raster::filled(across, down, 0);
        let mut confidences = Raster::filled(across, down, 0);
        let lines = disparities.pixels_mut().par_chunks_exact_mut(across);
        let lines = lines.zip(confidences.pixels_mut().par_chunks_exact_mut(across)).enumerate();
        lines.for_each(|(y, (line, confidences))| {
            let row = |offset: isize| &pixels[y.saturating_add_signed(offset).min(height - 1) * width..][..width];
            let rows = [-3, -1, 0, 1, 3].map(row);
            for (x, (disparity, confidence)) in line.iter_mut().zip(confidences).enumerate() {
                let pixel = rows[2][x];
                let choices = neighbors(rows, x);
                let mean = self.exponentials.mean(std::iter::zip(pixel.below, choices));
                let steps = (i32::from(mean) + i32::from(pixel.correction)).clamp(0, most);
                *disparity = steps as u16;
                *confidence = pixel.confidence;
            }
        });
        Look { disparities, confidences }
    }

    /// What is known of a pixel by its outputs.
    fn pixel(&self, [x, y]: [usize; 2], outputs: &[i16]) -> Pixel {
        let (width, height) = (self.inputs.colors.width(), self.inputs.colors.height());
        let [a, b] = self.inputs.winners.each_ref().map(|winners| winners.row(y.min(height - 1))[x.min(width - 1)]);
        let around = |i: usize| {
            let [columns, rows] = self.inputs.blocks;
            let row = (y / BLOCK + i / 3).saturating_sub(1).min(rows - 1);
            let column = (x / BLOCK + i % 3).saturating_sub(1).min(columns - 1);
            self.blocks.row(BLOCK * row)[column].0
        };
        let block =
            self.exponentials.mean_by_scores(std::array::from_fn::<_, 9, _>(|i| outputs[20 + i]), std::array::from_fn(around));
        let choice = self.exponentials.mean_by_scores([outputs[17], outputs[18], outputs[19]], [a, b, block]);
        let scores = &outputs[..NEIGHBORS];
        let greatest = scores.iter().copied().max().unwrap_or_default().into();
        Pixel {
            choice,
            correction: outputs[29],
            below: std::array::from_fn(|i| Exponentials::below(greatest, scores[i].into())),
            confidence: self.confidences[(i32::from(outputs[30]) + 128).clamp(0, 255) as usize],
        }
    }
}

/// The choices of a pixel and of its neighbours: first those at a distance of 1, then those of 3, row by row. `rows`
/// are those at distances from -3 to 3.
fn neighbors(rows: [&[Pixel]; 5], x: usize) -> [u16; NEIGHBORS] {
    let [above3, above, here, below, below3] = rows;
    let end = here.len() - 1;
    let [left3, left, right, right3] = [x.saturating_sub(3), x.saturating_sub(1), (x + 1).min(end), (x + 3).min(end)];
    [
        here[x],
        above[left],
        above[x],
        above[right],
        here[left],
        here[right],
        below[left],
        below[x],
        below[right],
        above3[left3],
        above3[x],
        above3[right3],
        here[left3],
        here[right3],
        below3[left3],
        below3[x],
        below3[right3],
    ]
    .map(|pixel| pixel.choice)
}
