//! The network: from inputs to disparities and confidences.

use std::sync::LazyLock;

use multiscopic_core::{Disparity, Search};
use rayon::prelude::*;

use super::{
    activations::Activations,
    block_disparities::BlockDisparities,
    dot_products::DotProducts,
    exponentials::Exponentials,
    inputs::{BLOCK, CHANNELS, Inputs},
    look::Look,
    operations::{Operations, RawOutputs, Skip},
    pixel_channels::{PIXEL_CHANNELS, PixelChannels},
    pixel_head::PixelHead,
    quantized_layer::{QuantizedLayer, Runs},
    weight_file::WeightFile,
};
use crate::{
    error::Result,
    images::{DisparityMap, Raster},
    stereo::engine::Engine,
};

/// The number of disparities is rounded up to a multiple of this: a volume has two in a slice, and is halved twice.
const DISPARITIES: usize = 8;

/// The network with its weights.
///
/// Its *volume part* is an hourglass over the pooled candidates of [`Inputs`], two disparities in a slice. It finds a
/// disparity for each block. Its *image part* is an hourglass over the pixels. It chooses between the disparities of
/// both passes of semi-global matching and of the blocks around, mixes those of neighbours, and adds a correction.
#[derive(Clone, Debug, PartialEq)]
pub struct DisparityNetwork {
    guide: [QuantizedLayer; 2],
    volume: VolumeLayers,
    image: ImageLayers,
    exponentials: Exponentials,
    confidences: [u8; 256],
}

/// Two layers whose outputs are added to their input.
#[derive(Clone, Debug, PartialEq)]
struct Residual([QuantizedLayer; 2]);

/// The layers of the volume part, from the largest volume to the smallest and back.
#[derive(Clone, Debug, PartialEq)]
struct VolumeLayers {
    first: QuantizedLayer,
    down: [Residual; 2],
    halve: [QuantizedLayer; 2],
    bottom: [Residual; 2],
    double: [[QuantizedLayer; 4]; 2],
    up: [Residual; 2],
    last: QuantizedLayer,
}

/// The layers of the image part, likewise.
#[derive(Clone, Debug, PartialEq)]
struct ImageLayers {
    first: QuantizedLayer,
    down: [Residual; 4],
    halve: [QuantizedLayer; 3],
    bottom: Residual,
    double: [[QuantizedLayer; 2]; 3],
    up: [QuantizedLayer; 3],
    last: [QuantizedLayer; 2],
}

impl DisparityNetwork {
    /// The file with the trained weights, which is part of the program.
    pub const TRAINED: &[u8] = include_bytes!("network.weights");

    /// The network with the trained weights.
    pub fn trained() -> &'static DisparityNetwork {
        static TRAINED: LazyLock<DisparityNetwork> =
            LazyLock::new(|| DisparityNetwork::new(DisparityNetwork::TRAINED).expect("the file of trained weights is one"));
        &TRAINED
    }

    /// The network with the weights of a file.
    ///
    /// # Errors
    /// If they are not those of this network.
    pub fn new(bytes: &[u8]) -> Result<DisparityNetwork> {
        let mut file = WeightFile::new(bytes)?;
        let guide = [file.layer(48, 16)?.layer(1), file.layer(9 * 16, 12)?.layer(3)];
        let volume = VolumeLayers::read(&mut file)?;
        let image = ImageLayers::read(&mut file)?;
        let exponentials = Exponentials(file.numbers()?);
        let confidences = file.bytes()?;
        file.finish()?;
        Ok(DisparityNetwork { guide, volume, image, exponentials, confidences })
    }

    /// The disparities of a search with these inputs, and the probabilities that they are at most a pixel off, times
    /// 255. Every pixel has one.
    ///
    /// The network looks twice: at the inputs, and at the same turned by half a turn. What it finds only in one position it is
    /// not sure of, and errors that differ cancel. The inputs may have a disparity more than the search, which is not found.
    pub fn disparities(&self, mut inputs: Inputs, search: &Search, engine: &Engine) -> (DisparityMap, Raster<u8>) {
        let operations = Operations { products: DotProducts::of(engine) };
        engine.pool().install(|| {
            let look = self.look(&inputs, operations);
            inputs.turn();
            look.with_turned(&self.look(&inputs, operations), search)
        })
    }

    /// What the network finds in one look.
    fn look(&self, inputs: &Inputs, operations: Operations) -> Look {
        let blocks = self.block_disparities(inputs, operations);
        self.pixel_disparities(inputs, &blocks, operations)
    }

    /// The disparities of blocks.
    fn block_disparities(&self, inputs: &Inputs, operations: Operations) -> BlockDisparities {
        let VolumeLayers { down, halve, bottom, double, up, .. } = &self.volume;
        let input = self.first_volume(inputs, operations);
        let fine = down[0].of_volume(operations, input);
        let middle = down[1].of_volume(operations, operations.halve_volume(&halve[0], &fine));
        let mut coarse = operations.halve_volume(&halve[1], &middle);
        for block in bottom {
            coarse = block.of_volume(operations, coarse);
        }
        let middle = up[0].of_volume(operations, operations.double_volume(&double[0], &coarse, &middle));
        let fine = operations.double_volume(&double[1], &middle, &fine);
        let fine = up[1].of_volume(operations, fine);
        self.volume_head(inputs, &fine, operations)
    }

    /// The activations of the volume part before its first block.
    fn first_volume(&self, inputs: &Inputs, operations: Operations) -> Activations {
        let [columns, rows] = inputs.blocks;
        let guide = self.guide(inputs, operations);
        let count = inputs.num_disparities;
        let slices = count.next_multiple_of(DISPARITIES) / 2;
        let bad = vec![Activations::MAX; columns * CHANNELS];
        let layer = &self.volume.first;
        operations.rows([slices, rows, columns], layer.outputs(), CHANNELS, Skip::Raw(&guide), |[slice, y]| {
            let runs = [2 * slice, 2 * slice + 1].map(|index| match index as usize {
                index if index < count => inputs.volume[(y as usize * count + index) * columns..][..columns].as_flattened(),
                _ => &bad,
            });
            (layer, runs)
        })
    }

    /// What the colours of the blocks add to all of their candidates.
    fn guide(&self, inputs: &Inputs, operations: Operations) -> RawOutputs {
        let [columns, rows] = inputs.blocks;
        let (width, height) = (inputs.colors.width(), inputs.colors.height());
        let mut blocks = Activations::zeros([1, rows, columns], 3 * BLOCK * BLOCK);
        blocks.rows_mut().for_each(|([_, row], out)| {
            for (column, out) in out.as_chunks_mut::<{ 3 * BLOCK * BLOCK }>().0.iter_mut().enumerate() {
                for (i, out) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    let (x, y) = (BLOCK * column + i % BLOCK, BLOCK * row + i / BLOCK);
                    *out = inputs.colors.row(y.min(height - 1))[x.min(width - 1)].map(|value| value >> 1);
                }
            }
        });
        let [first, second] = &self.guide;
        let hidden = operations
            .rows([1, rows, columns], first.outputs(), blocks.cell(), Skip::None, |[slice, y]| (first, [blocks.row(slice, y)]));
        operations.convolve_raw(second, &hidden)
    }

    /// Selects a disparity for each block: its candidate of the greatest score, which is the output of the last layer
    /// less the mean excess in B.
    fn volume_head(&self, inputs: &Inputs, fine: &Activations, operations: Operations) -> BlockDisparities {
        let layer = &self.volume.last;
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
                self.select_candidate((0..count).map(score))
            };
            scores.chunks_exact(2 * slices).enumerate().map(select).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<_>> = (0..rows).into_par_iter().map(row).collect();
        BlockDisparities::new(columns, rows.concat())
    }

    /// The mean of the candidates around the first one of the greatest score, and their share of all candidates.
    fn select_candidate(&self, scores: impl Iterator<Item = i32> + Clone) -> (u16, u8) {
        let (mut best, mut greatest) = (0, i32::MIN);
        for (index, score) in scores.clone().enumerate() {
            if score > greatest {
                (best, greatest) = (index, score);
            }
        }
        let (mut all, mut around, mut sum) = (0, 0, 0);
        for (index, score) in scores.enumerate() {
            let weight = self.exponentials.weight(Exponentials::below(greatest, score));
            all += weight;
            if index.abs_diff(best) <= 2 {
                around += weight;
                sum += weight * (Disparity::STEPS as u32 * index as u32);
            }
        }
        (((sum + around / 2) / around) as u16, (u32::from(Activations::MAX) * around / all) as u8)
    }

    /// The disparities and confidences of pixels.
    fn pixel_disparities(&self, inputs: &Inputs, blocks: &BlockDisparities, operations: Operations) -> Look {
        let ImageLayers { first, down, halve, bottom, double, up, last } = &self.image;
        let mut levels = Vec::new();
        let mut current = self.first_image(inputs, blocks, first, operations);
        for (level, block) in down.iter().enumerate() {
            current = block.of_image(operations, current);
            if let Some(halve) = halve.get(level) {
                let half = operations.halve_image(halve, &current);
                levels.push(std::mem::replace(&mut current, half));
            }
        }
        current = bottom.of_image(operations, current);
        for (layers, convolution) in double.iter().zip(up) {
            let skip = levels.pop().expect("a level for each");
            let doubled = operations.double_image(layers, &current, &skip);
            current = operations.convolve(convolution, &doubled, Skip::None);
        }
        let head = PixelHead { inputs, blocks, exponentials: &self.exponentials, confidences: &self.confidences };
        head.look(last, &current, operations)
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
        let channels = PixelChannels { inputs, blocks };
        let mut output = Activations::zeros([1, height / 2, width / 2], layer.outputs());
        let scratch = || (vec![0; 2 * width * PIXEL_CHANNELS], Vec::new());
        output.rows_mut().for_each_init(scratch, |(pixels, values), (place, out)| {
            let (upper, lower) = pixels.split_at_mut(width * PIXEL_CHANNELS);
            channels.row(2 * place[1], upper);
            channels.row(2 * place[1] + 1, lower);
            let runs = Runs { runs: [&*upper, &*lower], stride: 2 * PIXEL_CHANNELS };
            operations.row(layer, runs, Skip::None, place, values, out);
        });
        output
    }
}

impl Residual {
    /// Within slices and across them.
    fn of_volume(&self, operations: Operations, input: Activations) -> Activations {
        let [within, across] = &self.0;
        let hidden = operations.convolve(within, &input, Skip::None);
        operations.mix_slices(across, &hidden, Skip::Activations(&input))
    }

    /// Two convolutions.
    fn of_image(&self, operations: Operations, input: Activations) -> Activations {
        let [first, second] = &self.0;
        let hidden = operations.convolve(first, &input, Skip::None);
        operations.convolve(second, &hidden, Skip::Activations(&input))
    }
}

impl VolumeLayers {
    /// The channels of each level.
    const CHANNELS: [usize; 3] = [12, 16, 24];

    fn read(file: &mut WeightFile) -> Result<VolumeLayers> {
        let [fine, middle, coarse] = Self::CHANNELS;
        let residual = |file: &mut WeightFile, channels: usize| -> Result<Residual> {
            let within = file.layer(9 * channels, channels)?.layer(3);
            Ok(Residual([within, file.layer(3 * channels, channels)?.layer(3)]))
        };
        let first = file.layer(2 * CHANNELS, fine)?.layer(2);
        let down_fine = residual(file, fine)?;
        let halve_fine = file.layer(8 * fine, middle)?.layer(4);
        let down_middle = residual(file, middle)?;
        let halve_middle = file.layer(8 * middle, coarse)?.layer(4);
        let bottom = [residual(file, coarse)?, residual(file, coarse)?];
        let double_coarse = file.layer(coarse, 8 * middle)?.parts(1);
        let up_middle = residual(file, middle)?;
        let double_middle = file.layer(middle, 8 * fine)?.parts(1);
        let up_fine = residual(file, fine)?;
        Ok(VolumeLayers {
            first,
            down: [down_fine, down_middle],
            halve: [halve_fine, halve_middle],
            bottom,
            double: [double_coarse, double_middle],
            up: [up_middle, up_fine],
            last: file.layer(fine, 2)?.layer(1),
        })
    }
}

impl ImageLayers {
    /// The channels of the finest level and of all others.
    const CHANNELS: [usize; 2] = [24, 32];

    fn read(file: &mut WeightFile) -> Result<ImageLayers> {
        let [fine, coarse] = Self::CHANNELS;
        let convolution = |file: &mut WeightFile, channels: usize| -> Result<QuantizedLayer> {
            Ok(file.layer(9 * channels, channels)?.layer(3))
        };
        let residual = |file: &mut WeightFile, channels: usize| -> Result<Residual> {
            Ok(Residual([convolution(file, channels)?, convolution(file, channels)?]))
        };
        let first = file.layer(4 * PIXEL_CHANNELS, fine)?.layer(2);
        let down_fine = residual(file, fine)?;
        let halve_fine = file.layer(4 * fine, coarse)?.layer(2);
        let down_second = residual(file, coarse)?;
        let halve_second = file.layer(4 * coarse, coarse)?.layer(2);
        let down_third = residual(file, coarse)?;
        let halve_third = file.layer(4 * coarse, coarse)?.layer(2);
        let down_last = residual(file, coarse)?;
        let bottom = residual(file, coarse)?;
        let double_third = file.layer(coarse, 4 * coarse)?.parts(1);
        let up_third = convolution(file, coarse)?;
        let double_second = file.layer(coarse, 4 * coarse)?.parts(1);
        let up_second = convolution(file, coarse)?;
        let double_fine = file.layer(coarse, 4 * fine)?.parts(1);
        let up_fine = convolution(file, fine)?;
        Ok(ImageLayers {
            first,
            down: [down_fine, down_second, down_third, down_last],
            halve: [halve_fine, halve_second, halve_third],
            bottom,
            double: [double_third, double_second, double_fine],
            up: [up_third, up_second, up_fine],
            last: file.layer(fine, 4 * PixelHead::OUTPUTS)?.parts(1),
        })
    }
}
