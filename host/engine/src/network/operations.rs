//! The operations of a network on activations.

use multiscopic_core::network::MAX_ACTIVATION;
use rayon::prelude::*;

use super::{
    activations::Activations,
    dot_products::DotProducts,
    quantized_layer::{QuantizedLayer, Runs},
};

/// The values that a row's outputs are added to before they are clamped.
#[derive(Clone, Copy, Debug)]
pub enum Skip<'a> {
    /// Nothing.
    None,
    /// Activations.
    Activations(&'a Activations),
    /// Outputs of a layer, the same for every slice, which have not been clamped.
    Raw(&'a RawOutputs),
}

/// Outputs of a layer for the cells of an image, which have not been clamped.
#[derive(Clone, Debug)]
pub struct RawOutputs {
    row: usize,
    values: Vec<i16>,
}

impl RawOutputs {
    /// The outputs of row `y`, padded as those of [`QuantizedLayer::row`].
    pub fn row(&self, y: usize) -> &[i16] {
        &self.values[y * self.row..][..self.row]
    }
}

/// Operations with some instructions, on the threads of the current pool.
#[derive(Clone, Copy, Debug)]
pub struct Operations {
    /// The instructions.
    pub products: DotProducts,
}

impl Operations {
    /// A convolution of 3x3 cells within each slice.
    pub fn convolve(self, layer: &QuantizedLayer, input: &Activations, skip: Skip) -> Activations {
        self.rows(input.size(), layer.outputs(), input.cell(), skip, |[slice, y]| {
            (layer, [y - 1, y, y + 1].map(|y| input.padded_row(slice, y)))
        })
    }

    /// A convolution of 3x3 cells of an image, without clamping.
    pub fn convolve_raw(self, layer: &QuantizedLayer, input: &Activations) -> RawOutputs {
        let [_, height, width] = input.size();
        let row = width * layer.padded_outputs();
        let mut values = vec![0; height * row];
        values.par_chunks_exact_mut(row).enumerate().for_each(|(y, values)| {
            let y = y as isize;
            let runs = [y - 1, y, y + 1].map(|y| input.padded_row(0, y));
            layer.row(self.products, Runs { runs, stride: input.cell() }, values);
        });
        RawOutputs { row, values }
    }

    /// A product of the channels of each cell and of the same cells in the slices before and after.
    pub fn mix_slices(self, layer: &QuantizedLayer, input: &Activations, skip: Skip) -> Activations {
        self.rows(input.size(), layer.outputs(), input.cell(), skip, |[slice, y]| {
            (layer, [slice - 1, slice, slice + 1].map(|slice| input.row(slice, y)))
        })
    }

    /// A convolution within slices and a layer across them, whose outputs are added to their input.
    pub fn residual_in_volume(self, [within, across]: &[QuantizedLayer; 2], input: Activations) -> Activations {
        let hidden = self.convolve(within, &input, Skip::None);
        self.mix_slices(across, &hidden, Skip::Activations(&input))
    }

    /// Two convolutions in an image, whose outputs are added to their input.
    pub fn residual_in_image(self, [first, second]: &[QuantizedLayer; 2], input: Activations) -> Activations {
        let hidden = self.convolve(first, &input, Skip::None);
        self.convolve(second, &hidden, Skip::Activations(&input))
    }

    /// A product of the channels of 2x2 cells, which gives an image of half the size.
    pub fn halve_image(self, layer: &QuantizedLayer, input: &Activations) -> Activations {
        let [slices, height, width] = input.size();
        self.rows([slices, height / 2, width / 2], layer.outputs(), 2 * input.cell(), Skip::None, |[slice, y]| {
            (layer, [2 * y, 2 * y + 1].map(|y| input.row(slice, y)))
        })
    }

    /// A product of the channels of 2x2x2 cells, which gives a volume of half the size.
    pub fn halve_volume(self, layer: &QuantizedLayer, input: &Activations) -> Activations {
        let size = input.size().map(|side| side / 2);
        self.rows(size, layer.outputs(), 2 * input.cell(), Skip::None, |[slice, y]| {
            let rows = [[0, 0], [0, 1], [1, 0], [1, 1]];
            (layer, rows.map(|[below, down]| input.row(2 * slice + below, 2 * y + down)))
        })
    }

    /// Products of the channels of each cell, which give an image of twice the size. Those of `layers` give the upper
    /// and the lower row, two cells beside each other at a time.
    pub fn double_image(self, layers: &[QuantizedLayer; 2], input: &Activations, skip: &Activations) -> Activations {
        self.rows(skip.size(), skip.channels(), input.cell(), Skip::Activations(skip), |[slice, y]| {
            (&layers[y as usize % 2], [input.row(slice, y / 2)])
        })
    }

    /// Products of the channels of each cell, which give a volume of twice the size. The first two of `layers` give the rows of
    /// the first slice, the others those of the second.
    pub fn double_volume(self, layers: &[QuantizedLayer; 4], input: &Activations, skip: &Activations) -> Activations {
        self.rows(skip.size(), skip.channels(), input.cell(), Skip::Activations(skip), |[slice, y]| {
            (&layers[2 * (slice as usize % 2) + y as usize % 2], [input.row(slice / 2, y / 2)])
        })
    }

    /// Activations of `size`, row by row. `of_row` gives the layer and the inputs of a row in a slice, `stride` bytes
    /// for each position.
    pub fn rows<'a, const RUNS: usize>(
        self,
        size: [usize; 3],
        channels: usize,
        stride: usize,
        skip: Skip,
        of_row: impl Fn([isize; 2]) -> (&'a QuantizedLayer, [&'a [u8]; RUNS]) + Sync,
    ) -> Activations {
        let mut output = Activations::zeros(size, channels);
        output.rows_mut().for_each_init(Vec::new, |values, (place, out)| {
            let (layer, runs) = of_row(place.map(|index| index as isize));
            self.row(layer, Runs { runs, stride }, skip, place, values, out);
        });
        output
    }

    /// Computes a row of activations. `values` is scratch memory.
    pub fn row<const RUNS: usize>(
        self,
        layer: &QuantizedLayer,
        inputs: Runs<RUNS>,
        skip: Skip,
        [slice, y]: [usize; 2],
        values: &mut Vec<i16>,
        out: &mut [u8],
    ) {
        let positions = out.len() / layer.outputs();
        values.resize(positions * layer.padded_outputs(), 0);
        layer.row(self.products, inputs, values);
        let stride = layer.padded_outputs();
        match skip {
            Skip::None => clamp(values, stride, out, layer.outputs(), |_| [0; 4]),
            Skip::Activations(skip) => {
                let skip = skip.row(slice as isize, y as isize).as_chunks::<4>().0;
                clamp(values, stride, out, layer.outputs(), |i| skip[i].map(i16::from));
            }
            Skip::Raw(skip) => {
                let (skip, count, stride) = (skip.row(y), layer.outputs() / 4, layer.padded_outputs());
                let at = |i| [0, 1, 2, 3].map(|lane| skip[i / count * stride + 4 * (i % count) + lane]);
                clamp(values, stride, out, layer.outputs(), at);
            }
        }
    }
}

/// Clamps the outputs of a layer, `count` at each position, to activations. What `skip` gives for each four of them is
/// added before. The outputs of a position are padded to `stride`.
fn clamp(values: &[i16], stride: usize, out: &mut [u8], count: usize, skip: impl Fn(usize) -> [i16; 4]) {
    let groups = count / 4;
    for (position, (values, out)) in values.chunks_exact(stride).zip(out.chunks_exact_mut(count)).enumerate() {
        let values = &values.as_chunks::<4>().0[..groups];
        for (i, (values, out)) in values.iter().zip(out.as_chunks_mut::<4>().0).enumerate() {
            let skip = skip(position * groups + i);
            *out = std::array::from_fn(|lane| values[lane].saturating_add(skip[lane]).clamp(0, MAX_ACTIVATION.into()) as u8);
        }
    }
}
