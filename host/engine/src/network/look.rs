//! The result of one look of the network at its inputs, and the combination of two looks.

use multiscopic_core::{
    Disparity, SearchSpace,
    network::{BLOCK, PixelHead, PixelScores, fuse_rotations},
};
use rayon::prelude::*;

use super::{
    activations::Activations,
    block_disparities::BlockDisparities,
    inputs::Inputs,
    operations::Operations,
    quantized_layer::{QuantizedLayer, Runs},
};
use crate::{disparity_map::DisparityMap, raster::Raster};

/// The result of one look of the network at its inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Disparities from the least of the search on, in steps of a [`Disparity`].
    pub disparities: Raster<u16>,
    /// The probabilities that they are at most a pixel off, times 255.
    pub confidences: Raster<u8>,
}

impl Look {
    /// Runs the last layer and reads disparities and confidences from its outputs. The two `layers` compute the outputs of
    /// the upper and the lower of two rows.
    pub fn of_outputs(
        head: PixelHead,
        layers: &[QuantizedLayer; 2],
        input: &Activations,
        (inputs, blocks): (&Inputs, &BlockDisparities),
        operations: Operations,
    ) -> Look {
        let [across, down] = [inputs.colors.width(), inputs.colors.height()];
        let [width, height] = inputs.blocks.map(|count| BLOCK * count);
        let mut choices = vec![0; width * height];
        let mut scores = vec![PixelScores::default(); width * height];
        let rows = choices.par_chunks_exact_mut(width).zip(scores.par_chunks_exact_mut(width)).enumerate();
        rows.for_each_init(Vec::new, |outputs, (y, (choices, scores))| {
            let layer = &layers[y % 2];
            outputs.resize(width / 2 * layer.padded_outputs(), 0);
            let runs = Runs { runs: [input.row(0, (y / 2) as isize)], stride: input.cell() };
            layer.row(operations.products, runs, outputs);
            let winners = inputs.winners.each_ref().map(|winners| winners.row(y.min(down - 1)));
            for (x, (choice, scores)) in choices.iter_mut().zip(scores).enumerate() {
                let outputs = &outputs[x / 2 * layer.padded_outputs() + x % 2 * PixelHead::OUTPUTS..];
                let outputs = outputs.first_chunk().expect("as many outputs as the head takes");
                (*choice, *scores) =
                    head.pixel(outputs, winners.map(|winners| winners[x.min(across - 1)]), blocks.around([x, y]));
            }
        });

        let most = (Disparity::STEPS * (inputs.num_disparities as i32 - 1)) as u16;
        let mut disparities = Raster::filled(across, down, 0);
        let mut confidences = Raster::filled(across, down, 0);
        let lines = disparities.pixels_mut().par_chunks_exact_mut(across);
        let lines = lines.zip(confidences.pixels_mut().par_chunks_exact_mut(across)).enumerate();
        lines.for_each(|(y, (line, confidences))| {
            let row = |offset: isize| &choices[y.saturating_add_signed(offset).min(height - 1) * width..][..width];
            let rows = [-3, -1, 0, 1, 3].map(row);
            let found = line.iter_mut().zip(confidences).zip(&scores[y * width..]);
            for (x, ((disparity, confidence), pixel)) in found.enumerate() {
                (*disparity, *confidence) = head.disparity(rows, x, pixel, most);
            }
        });
        Look { disparities, confidences }
    }

    /// The disparities and confidences of a search by this look and by one at [turned](Inputs::turn) inputs: see
    /// [`fuse_rotations`].
    pub fn with_turned(&self, other: &Look, search: &SearchSpace) -> (DisparityMap, Raster<u8>) {
        let (width, height) = (search.width(), search.height());
        let least = i32::from(search.min_disparity()) * Disparity::STEPS;
        let most = Disparity::STEPS * (search.num_disparities() as i32 - 1);
        let mut map = DisparityMap::filled(width, height, None);
        let mut confidences = Raster::filled(width, height, 0);
        for y in 0..height {
            let other_row = other.disparities.height() - 1 - y;
            let others = other.disparities.row(other_row).iter().zip(other.confidences.row(other_row)).rev();
            let these = self.disparities.row(y).iter().zip(self.confidences.row(y)).zip(others);
            let found = map.row_mut(y).iter_mut().zip(confidences.row_mut(y));
            for ((disparity, confidence), ((&a, &p), (&b, &q))) in found.zip(these) {
                let (steps, sure) = fuse_rotations([a, b], [p, q]);
                *disparity = Disparity::from_bits((least + i32::from(steps).min(most)) as i16);
                *confidence = sure;
            }
        }
        (map, confidences)
    }
}
