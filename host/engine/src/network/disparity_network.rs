//! The network: from inputs to disparities and confidences.

use std::sync::LazyLock;

use multiscopic_core::{
    SearchSpace,
    network::{
        BLOCK, CANDIDATE_CHANNELS, ImageLayers, MAX_ACTIVATION, NetworkLayers, PIXEL_CHANNELS, PixelHead, Skeleton,
        TRAINED_WEIGHTS, VolumeLayers,
    },
};
use rayon::prelude::*;

use super::{
    activations::Activations,
    block_disparities::BlockDisparities,
    dot_products::DotProducts,
    inputs::Inputs,
    look::Look,
    operations::{Operations, RawOutputs, Skip},
    quantized_layer::{QuantizedLayer, Runs},
};
use crate::{disparity_map::DisparityMap, engine::Engine, error::EngineError, raster::Raster};

/// The network with its weights, on threads: see [`NetworkLayers`].
#[derive(Clone, Debug, PartialEq)]
pub struct DisparityNetwork(NetworkLayers<QuantizedLayer>);

impl DisparityNetwork {
    /// The network with the trained weights.
    pub fn trained() -> &'static DisparityNetwork {
        static TRAINED: LazyLock<DisparityNetwork> =
            LazyLock::new(|| DisparityNetwork::new(TRAINED_WEIGHTS).expect("the file of trained weights is one"));
        &TRAINED
    }

    /// The network with the weights of a file.
    ///
    /// # Errors
    /// If they are not those of this network.
    pub fn new(bytes: &[u8]) -> Result<DisparityNetwork, EngineError> {
        let layers = NetworkLayers::read(bytes, QuantizedLayer::of).map_err(EngineError::Weights)?;
        Ok(DisparityNetwork(layers))
    }

    /// The disparities of a search with these inputs, and the probabilities that they are at most a pixel off, times
    /// 255. Every pixel has one.
    ///
    /// The network looks twice: at the inputs, and at the same turned by half a turn. Disparities found in one position only
    /// get a low confidence, and errors that differ cancel. If the inputs have a disparity more than the search, it is never
    /// selected.
    pub fn disparities(&self, mut inputs: Inputs, search: &SearchSpace, engine: &Engine) -> (DisparityMap, Raster<u8>) {
        let operations = Operations { products: DotProducts::of(engine) };
        engine.install(|| {
            let look = self.look(&inputs, operations);
            inputs.turn();
            look.with_turned(&self.look(&inputs, operations), search)
        })
    }

    /// Runs the network once over the inputs.
    fn look(&self, inputs: &Inputs, operations: Operations) -> Look {
        let blocks = self.block_disparities(inputs, operations);
        self.pixel_disparities(inputs, &blocks, operations)
    }

    /// The disparities of blocks.
    fn block_disparities(&self, inputs: &Inputs, operations: Operations) -> BlockDisparities {
        let VolumeLayers { down, halve, bottom, double, up, .. } = &self.0.volume;
        let input = self.first_volume(inputs, operations);
        let fine = operations.residual_in_volume(&down[0], input);
        let middle = operations.residual_in_volume(&down[1], operations.halve_volume(&halve[0], &fine));
        let mut coarse = operations.halve_volume(&halve[1], &middle);
        for block in bottom {
            coarse = operations.residual_in_volume(block, coarse);
        }
        let middle = operations.residual_in_volume(&up[0], operations.double_volume(&double[0], &coarse, &middle));
        let fine = operations.double_volume(&double[1], &middle, &fine);
        let fine = operations.residual_in_volume(&up[1], fine);
        self.volume_head(inputs, &fine, operations)
    }

    /// The activations of the volume part before its first block.
    fn first_volume(&self, inputs: &Inputs, operations: Operations) -> Activations {
        let [columns, rows] = inputs.blocks;
        let guide = self.guide(inputs, operations);
        let count = inputs.num_disparities;
        let slices = count.next_multiple_of(Skeleton::DISPARITIES) / 2;
        let bad = vec![MAX_ACTIVATION; columns * CANDIDATE_CHANNELS];
        let layer = &self.0.volume.first;
        operations.rows([slices, rows, columns], layer.outputs(), CANDIDATE_CHANNELS, Skip::Raw(&guide), |[slice, y]| {
            let runs = [2 * slice, 2 * slice + 1].map(|index| match index as usize {
                index if index < count => inputs.volume[(y as usize * count + index) * columns..][..columns].as_flattened(),
                _ => &bad,
            });
            (layer, runs)
        })
    }

    /// Computes the contribution of the blocks' colours, which is added to all candidates of a block.
    fn guide(&self, inputs: &Inputs, operations: Operations) -> RawOutputs {
        let [columns, rows] = inputs.blocks;
        let (width, height) = (inputs.colors.width(), inputs.colors.height());
        let mut blocks = Activations::zeros([1, rows, columns], Skeleton::BLOCK_COLORS);
        blocks.rows_mut().for_each(|([_, row], out)| {
            for (column, out) in out.as_chunks_mut::<{ Skeleton::BLOCK_COLORS }>().0.iter_mut().enumerate() {
                for (i, out) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    let (x, y) = (BLOCK * column + i % BLOCK, BLOCK * row + i / BLOCK);
                    *out = inputs.colors.row(y.min(height - 1))[x.min(width - 1)].map(|value| value >> 1);
                }
            }
        });
        let [first, second] = &self.0.guide;
        let hidden = operations
            .rows([1, rows, columns], first.outputs(), blocks.cell(), Skip::None, |[slice, y]| (first, [blocks.row(slice, y)]));
        operations.convolve_raw(second, &hidden)
    }

    /// Selects a disparity for each block: its candidate of the greatest score, which is the output of the last layer
    /// less the mean excess in B.
    fn volume_head(&self, inputs: &Inputs, fine: &Activations, operations: Operations) -> BlockDisparities {
        let layer = &self.0.volume.last;
        let ([columns, rows], count) = (inputs.blocks, inputs.num_disparities);
        let [slices, ..] = fine.size();
        let stride = layer.padded_outputs();
        let row = |row: usize| {
            let mut outputs = vec![0; columns * stride];
            let mut scores = vec![0; columns * 2 * slices];
            for slice in 0..slices {
                let runs = Runs { runs: [fine.row(slice as isize, row as isize)], stride: fine.cell() };
                layer.row(operations.products, runs, &mut outputs);
                for (scores, outputs) in scores.chunks_exact_mut(2 * slices).zip(outputs.chunks_exact(stride)) {
                    scores[2 * slice..][..2].copy_from_slice(&outputs[..2]);
                }
            }
            let select = |(column, scores): (usize, &[i16])| {
                let score = |index: usize| {
                    let excess = inputs.volume[(row * count + index) * columns + column][4];
                    i32::from(scores[index]) - i32::from(excess)
                };
                self.0.exponentials.selected((0..count).map(score))
            };
            scores.chunks_exact(2 * slices).enumerate().map(select).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<_>> = (0..rows).into_par_iter().map(row).collect();
        BlockDisparities::new(columns, rows.concat())
    }

    /// The disparities and confidences of pixels.
    fn pixel_disparities(&self, inputs: &Inputs, blocks: &BlockDisparities, operations: Operations) -> Look {
        let ImageLayers { first, down, halve, bottom, double, up, last } = &self.0.image;
        let mut levels = Vec::new();
        let mut current = self.first_image(inputs, blocks, first, operations);
        for (level, block) in down.iter().enumerate() {
            current = operations.residual_in_image(block, current);
            if let Some(halve) = halve.get(level) {
                let half = operations.halve_image(halve, &current);
                levels.push(std::mem::replace(&mut current, half));
            }
        }
        current = operations.residual_in_image(bottom, current);
        for (layers, convolution) in double.iter().zip(up) {
            let skip = levels.pop().expect("a level for each");
            let doubled = operations.double_image(layers, &current, &skip);
            current = operations.convolve(convolution, &doubled, Skip::None);
        }
        let head = PixelHead { exponentials: &self.0.exponentials, confidences: &self.0.confidences };
        Look::of_outputs(head, last, &current, (inputs, blocks), operations)
    }

    /// The activations of the image part before its first block, at half the size.
    fn first_image(
        &self,
        inputs: &Inputs,
        blocks: &BlockDisparities,
        layer: &QuantizedLayer,
        operations: Operations,
    ) -> Activations {
        let [columns, rows] = inputs.blocks;
        let (width, height) = (BLOCK * columns, BLOCK * rows);
        let mut output = Activations::zeros([1, height / 2, width / 2], layer.outputs());
        let scratch = || (vec![0; 2 * width * PIXEL_CHANNELS], Vec::new());
        output.rows_mut().for_each_init(scratch, |(pixels, values), (place, out)| {
            let (upper, lower) = pixels.split_at_mut(width * PIXEL_CHANNELS);
            inputs.pixel_row(2 * place[1], blocks).channels(upper);
            inputs.pixel_row(2 * place[1] + 1, blocks).channels(lower);
            let runs = Runs { runs: [&*upper, &*lower], stride: 2 * PIXEL_CHANNELS };
            operations.row(layer, runs, Skip::None, place, values, out);
        });
        output
    }
}
