//! A layer along a row of cells.

use core::{array, iter};

use crate::{
    kernel::Isa,
    network::{LayerRecord, NetworkLayers},
};

/// The network, and the instructions that compute it.
#[derive(Clone, Copy, Debug)]
pub struct NetworkOn<'a, I> {
    /// The instructions.
    pub isa: I,
    /// The layers.
    pub layers: &'a NetworkLayers<LayerRecord<'a>>,
}

/// The positions whose sums are computed together.
const POSITIONS: usize = 4;

/// Computes the outputs of a layer at the first `count` positions of a row, and gives each to `put`: the position, the output,
/// and its value.
///
/// The inputs lie side by side in as many runs as the layer has, and those of a position `stride` bytes behind those of the
/// position before. A run without inputs counts as zeros.
#[inline(always)]
pub fn layer_row<I: Isa, const RUNS: usize>(
    isa: I,
    layer: &LayerRecord,
    runs: [&[u8]; RUNS],
    stride: usize,
    count: usize,
    mut put: impl FnMut(usize, usize, i16),
) {
    let length = layer.run_length();
    for (output, (weights, of_output)) in layer.outputs().enumerate() {
        for first in (0..count).step_by(POSITIONS) {
            // Past the last one, it is computed again.
            let positions: [usize; POSITIONS] = array::from_fn(|i| (first + i).min(count - 1));
            let mut sums = [of_output.bias; POSITIONS];
            for (run, weights) in iter::zip(runs, weights.chunks_exact(length.max(1))) {
                if !run.is_empty() {
                    let inputs = positions.map(|position| run.get(position * stride..).unwrap_or_default());
                    sums = isa.add_products(sums, weights, inputs);
                }
            }
            for (position, sum) in (first..count).zip(sums) {
                put(position, output, of_output.of(sum));
            }
        }
    }
}
