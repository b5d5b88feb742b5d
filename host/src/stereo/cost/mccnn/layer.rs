//! Layers of a network as matrix products, with the widest vectors of the processor.
//!
//! A product is computed in tiles of a few positions and [`PANEL`] outputs, whose sums stay in registers from
//! the first input to the last. In a convolution the inputs of neighbouring positions overlap. They are read
//! in place; only the weights are rearranged, once. Sums are fused multiply-adds in the order of the inputs,
//! so all vectors that have these give the same bits (AVX2, AVX-512, Neon).

use std::{array, iter, ops::Range};

use pulp::{Arch, Simd, WithSimd};

/// The outputs of a panel, which are computed together: two of the widest vectors.
pub(crate) const PANEL: usize = 32;

/// The weights from one input to the outputs of a panel, aligned to the widest vector.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
struct PanelWeights([f32; PANEL]);

/// The weights and biases of a layer, in panels of [`PANEL`] outputs. The last panel is padded with 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layer {
    inputs: usize,
    outputs: usize,
    biases: Vec<PanelWeights>,
    /// Panel by panel, and within a panel input by input.
    weights: Vec<PanelWeights>,
}

impl Layer {
    /// The layer with these biases, one for each output, and the `weight` from an input to an output.
    pub fn new(inputs: usize, biases: &[f32], weight: impl Fn(usize, usize) -> f32) -> Layer {
        let mut layer = Layer { inputs, outputs: biases.len(), biases: Vec::new(), weights: Vec::new() };
        for (panel, biases) in biases.chunks(PANEL).enumerate() {
            let fill = |value: &dyn Fn(usize) -> f32| {
                let mut line = PanelWeights([0.0; PANEL]);
                line.0[..biases.len()].iter_mut().enumerate().for_each(|(output, line)| *line = value(output));
                line
            };
            layer.biases.push(fill(&|output| biases[output]));
            layer.weights.extend((0..inputs).map(|input| fill(&|output| weight(input, panel * PANEL + output))));
        }
        layer
    }

    /// Computes the outputs at `count` positions of a line, by a convolution of `SIDE` x `SIDE` pixels with
    /// `CHANNELS` channels. `out` has the outputs position by position.
    ///
    /// The inputs of position `i` are the pixels `i` to `i + SIDE` of each of `rows`. An output is its bias
    /// plus the sum of its weights times the inputs. For a fully connected layer, `SIDE` is 1.
    ///
    /// # Panics
    /// If `rows` are too short, the layer has another number of inputs, or `out` has another length.
    pub fn apply<const SIDE: usize, const CHANNELS: usize>(
        &self,
        rows: [&[f32]; SIDE],
        count: usize,
        activation: Activation,
        out: &mut [f32],
    ) {
        assert_eq!(out.len(), count * self.outputs, "the outputs of a layer");
        let outputs = self.outputs;
        self.products::<SIDE, CHANNELS>(
            rows,
            count,
            |_| 0..self.biases.len(),
            |position, first, sums| {
                let out = &mut out[position * outputs..][first..outputs];
                match activation {
                    Activation::Linear => out.iter_mut().zip(sums).for_each(|(out, &sum)| *out = sum),
                    Activation::Relu => out.iter_mut().zip(sums).for_each(|(out, &sum)| *out = sum.max(0.0)),
                }
            },
        );
    }

    /// Computes outputs as [`apply`](Layer::apply) does, but only the panels that are needed: `panels` tells
    /// which those are for a range of positions. Calls `take` with a position, the index of the first output
    /// of a panel, and the panel's outputs.
    pub fn products<const SIDE: usize, const CHANNELS: usize>(
        &self,
        rows: [&[f32]; SIDE],
        count: usize,
        panels: impl Fn(Range<usize>) -> Range<usize>,
        take: impl FnMut(usize, usize, &[f32; PANEL]),
    ) {
        Arch::new().dispatch(Products::<SIDE, CHANNELS, _, _> { layer: self, rows, count, panels, take });
    }
}

/// The function that turns a sum into an output.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Activation {
    /// The sum itself.
    Linear,
    /// The sum, or 0 if it is negative.
    Relu,
}

/// A matrix product, which any vectors can compute.
struct Products<'a, const SIDE: usize, const CHANNELS: usize, P, T> {
    layer: &'a Layer,
    rows: [&'a [f32]; SIDE],
    count: usize,
    panels: P,
    take: T,
}

impl<const SIDE: usize, const CHANNELS: usize, P, T> WithSimd for Products<'_, SIDE, CHANNELS, P, T>
where
    P: Fn(Range<usize>) -> Range<usize>,
    T: FnMut(usize, usize, &[f32; PANEL]),
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Tile sizes for which sums, an input and its weights fill the registers: 32 with AVX-512 and Neon,
        // 16 with AVX2.
        match S::F32_LANES {
            16 => self.tiles::<S, 14, 2>(simd),
            8 => self.tiles::<S, 6, 2>(simd),
            _ => self.tiles::<S, 6, 4>(simd),
        }
    }
}

impl<const SIDE: usize, const CHANNELS: usize, P, T> Products<'_, SIDE, CHANNELS, P, T>
where
    P: Fn(Range<usize>) -> Range<usize>,
    T: FnMut(usize, usize, &[f32; PANEL]),
{
    /// The inputs of a position in one row.
    const LENGTH: usize = SIDE * CHANNELS;

    /// Computes all tiles of `POSITIONS` x [`PANEL`] sums, each in parts of `VECTORS` vectors per position.
    #[inline(always)]
    fn tiles<S: Simd, const POSITIONS: usize, const VECTORS: usize>(self, simd: S) {
        let Products { layer, rows, count, panels, mut take } = self;
        assert_eq!(layer.inputs, SIDE * Self::LENGTH, "the inputs of a layer");
        let reach = (POSITIONS - 1) * CHANNELS + Self::LENGTH;
        // A line shorter than a tile is padded.
        let padded: [Vec<f32>; SIDE];
        let rows = if count < POSITIONS {
            padded = rows.map(|row| row.iter().copied().chain(iter::repeat(0.0)).take(reach).collect());
            array::from_fn(|i| padded[i].as_slice())
        } else {
            rows
        };
        let mut sums = [[0.0; PANEL]; POSITIONS];
        let mut done = 0;
        while done < count {
            // The last tile overlaps the one before, rather than reaching beyond the end.
            let first = done.min(count.saturating_sub(POSITIONS));
            let end = count.min(first + POSITIONS);
            for panel in panels(done..end) {
                let rows = rows.map(|row| &row[first * CHANNELS..][..reach]);
                let weights = &layer.weights[panel * layer.inputs..][..layer.inputs];
                Self::tile::<S, POSITIONS, VECTORS>(simd, rows, &layer.biases[panel], weights, &mut sums);
                for position in done..end {
                    take(position, panel * PANEL, &sums[position - first]);
                }
            }
            done = end;
        }
    }

    /// Computes the sums of a tile.
    #[inline(always)]
    fn tile<S: Simd, const POSITIONS: usize, const VECTORS: usize>(
        simd: S,
        rows: [&[f32]; SIDE],
        biases: &PanelWeights,
        weights: &[PanelWeights],
        sums: &mut [[f32; PANEL]; POSITIONS],
    ) {
        for part in 0..PANEL / S::F32_LANES / VECTORS {
            let vectors = |weights: &PanelWeights| -> [S::f32s; VECTORS] {
                let vectors = S::as_simd_f32s(&weights.0).0;
                array::from_fn(|i| vectors[part * VECTORS + i])
            };
            let mut accumulators = [vectors(biases); POSITIONS];
            for (row, weights) in rows.iter().zip(weights.chunks_exact(Self::LENGTH)) {
                // Constant iteration counts let the compiler keep the sums in registers.
                for (inputs, weights) in row.windows((POSITIONS - 1) * CHANNELS + 1).zip(weights) {
                    let weights = vectors(weights);
                    for (position, accumulators) in accumulators.iter_mut().enumerate() {
                        let input = simd.splat_f32s(inputs[position * CHANNELS]);
                        for (sum, weight) in accumulators.iter_mut().zip(weights) {
                            *sum = simd.mul_add_e_f32s(input, weight, *sum);
                        }
                    }
                }
            }
            for (sums, accumulators) in sums.iter_mut().zip(&accumulators) {
                S::as_mut_simd_f32s(sums).0[part * VECTORS..][..VECTORS].copy_from_slice(accumulators);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A random number from -1 to 1.
    fn random(seed: &mut u32) -> f32 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*seed >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    /// The outputs of the layer by `simd`, for the panels that `panels` names.
    fn outputs<const SIDE: usize, const CHANNELS: usize>(
        simd: impl Simd,
        layer: &Layer,
        rows: [&[f32]; SIDE],
        count: usize,
        panels: impl Fn(Range<usize>) -> Range<usize>,
    ) -> Vec<f32> {
        let mut out = vec![f32::NAN; count * layer.outputs];
        let take = |position: usize, first: usize, sums: &[f32; PANEL]| {
            let out = &mut out[position * layer.outputs..][first..layer.outputs];
            for (out, sum) in out.iter_mut().zip(sums) {
                assert!(out.is_nan(), "position {position} comes once");
                *out = *sum;
            }
        };
        Simd::vectorize(simd, Products::<SIDE, CHANNELS, _, _> { layer, rows, count, panels, take });
        out
    }

    /// Compares a random layer with direct sums in `f64`, and all available vectors with each other.
    fn check<const SIDE: usize, const CHANNELS: usize>(outputs: usize, count: usize, seed: &mut u32) {
        let inputs = SIDE * SIDE * CHANNELS;
        let mut values = |count: usize| -> Vec<f32> { (0..count).map(|_| random(seed)).collect() };
        let (weights, biases) = (values(inputs * outputs), values(outputs));
        let rows: [Vec<f32>; SIDE] = array::from_fn(|_| values((count - 1 + SIDE) * CHANNELS));
        let rows: [&[f32]; SIDE] = array::from_fn(|i| rows[i].as_slice());
        let layer = Layer::new(inputs, &biases, |input, output| weights[output * inputs + input]);

        let mut widest = vec![0.0; count * outputs];
        layer.apply::<SIDE, CHANNELS>(rows, count, Activation::Linear, &mut widest);
        let scalar = self::outputs::<SIDE, CHANNELS>(pulp::Scalar::new(), &layer, rows, count, |_| 0..outputs.div_ceil(PANEL));
        for (i, (&widest, &scalar)) in widest.iter().zip(&scalar).enumerate() {
            let (position, output) = (i / outputs, i % outputs);
            let seen = rows.iter().flat_map(|row| &row[position * CHANNELS..][..SIDE * CHANNELS]);
            let products = seen.zip(&weights[output * inputs..]).map(|(&x, &w)| f64::from(x) * f64::from(w));
            let expected = f64::from(biases[output]) + products.sum::<f64>();
            for found in [widest, scalar] {
                let error = (f64::from(found) - expected).abs();
                assert!(error < 1e-7 * (inputs as f64 + 1.0), "{found} instead of {expected} at {position}, {output}");
            }
        }

        let mut relu = vec![f32::NAN; count * outputs];
        layer.apply::<SIDE, CHANNELS>(rows, count, Activation::Relu, &mut relu);
        assert!(relu.iter().zip(&widest).all(|(&relu, &linear)| relu == linear.max(0.0)));
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = pulp::x86::V3::try_new() {
            let last = outputs.div_ceil(PANEL) - 1;
            let found = self::outputs::<SIDE, CHANNELS>(simd, &layer, rows, count, |_| last..last + 1);
            for (i, (found, widest)) in found.iter().zip(&widest).enumerate() {
                assert!(if i % outputs < last * PANEL { found.is_nan() } else { found == widest }, "AVX2, {i}");
            }
        }
    }

    #[test]
    fn layers_of_any_size_are_direct_sums() {
        let mut seed = 1;
        for count in [1, 2, 5, 6, 7, 13, 14, 15, 28, 33] {
            check::<3, 1>(64, count, &mut seed);
            check::<1, 64>(31 + count, count, &mut seed);
            check::<1, 112>(384, count, &mut seed);
        }
        check::<3, 64>(64, 17, &mut seed);
        check::<3, 112>(112, 9, &mut seed);
        check::<1, 384>(384, 15, &mut seed);
    }
}
