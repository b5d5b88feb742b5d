//! Layers in floats as matrix products, with the widest vectors of the processor.
//!
//! A product is computed in tiles of a few positions and [`PANEL`](FloatLayer::PANEL) outputs, whose sums stay in registers from
//! the first input to the last. In a convolution the inputs of neighbouring positions overlap. They are read
//! in place; only the weights are rearranged, once. Sums are fused multiply-adds in the order of the inputs,
//! so all vectors that have these give the same bits (AVX2, AVX-512, Neon).

use std::{array, iter, ops::Range};

use super::dot_products::{FLOAT_PANEL, FloatLine, FloatSums, FloatTask, FloatVectors};

/// The weights and biases of a layer, in panels of [`PANEL`](FloatLayer::PANEL) outputs. The last panel is padded with 0.
#[derive(Clone, Debug, PartialEq)]
pub struct FloatLayer {
    side: usize,
    channels: usize,
    outputs: usize,
    biases: Vec<FloatLine>,
    /// Panel by panel, and within a panel input by input.
    weights: Vec<FloatLine>,
}

/// The function that turns a sum into an output.
#[derive(Clone, Copy, Debug)]
pub enum Activation {
    /// The sum itself.
    Linear,
    /// The sum, or 0 if it is negative.
    Relu,
}

impl FloatLayer {
    /// The outputs that are computed together.
    pub const PANEL: usize = FLOAT_PANEL;

    /// A convolution of `side` x `side` pixels with `channels` channels, with these biases, one for each output, and the
    /// `weight` from an input to an output. Inputs are ordered by rows, and within a row by pixels. For a fully connected
    /// layer, `side` is 1.
    pub fn new(side: usize, channels: usize, biases: &[f32], weight: impl Fn(usize, usize) -> f32) -> FloatLayer {
        let mut layer = FloatLayer { side, channels, outputs: biases.len(), biases: Vec::new(), weights: Vec::new() };
        for (panel, biases) in biases.chunks(FLOAT_PANEL).enumerate() {
            let fill = |value: &dyn Fn(usize) -> f32| {
                let mut line = FloatLine([0.0; FLOAT_PANEL]);
                line.0[..biases.len()].iter_mut().enumerate().for_each(|(output, line)| *line = value(output));
                line
            };
            layer.biases.push(fill(&|output| biases[output]));
            layer.weights.extend((0..layer.inputs()).map(|input| fill(&|output| weight(input, panel * FLOAT_PANEL + output))));
        }
        layer
    }

    fn inputs(&self) -> usize {
        self.side * self.side * self.channels
    }

    /// Computes the outputs at `count` positions of a line, position by position. An output is its bias plus the sum of its
    /// weights times the inputs.
    ///
    /// The inputs of position `i` are the pixels `i` to `i + side` of each of `rows`.
    ///
    /// # Panics
    /// If there are not as many `rows` as the convolution has, they are too short, or `out` has another length.
    pub fn apply(&self, rows: &[&[f32]], count: usize, activation: Activation, out: &mut [f32]) {
        assert_eq!(out.len(), count * self.outputs, "the outputs of a layer");
        self.compute(rows, count, &|_| 0..self.biases.len(), Use::Store(out, activation));
    }

    /// Computes outputs as [`apply`](FloatLayer::apply) does, but only the panels that are needed: `panels` tells
    /// which those are for a range of positions. Calls `take` with a position, the index of the first output
    /// of a panel, and the panel's outputs.
    ///
    /// # Panics
    /// As [`apply`](FloatLayer::apply).
    pub fn products(
        &self,
        rows: &[&[f32]],
        count: usize,
        panels: &dyn Fn(Range<usize>) -> Range<usize>,
        take: &mut dyn FnMut(usize, usize, &[f32; FLOAT_PANEL]),
    ) {
        self.compute(rows, count, panels, Use::Take(take));
    }

    fn compute<'a>(
        &'a self,
        rows: &'a [&'a [f32]],
        count: usize,
        panels: &'a dyn Fn(Range<usize>) -> Range<usize>,
        sums: Use<'a>,
    ) {
        let widest = FloatSums::available().next().expect("plain ones are available");
        widest.run(Products { layer: self, rows, count, panels, sums });
    }
}

/// The use of the sums of panels.
enum Use<'a> {
    Store(&'a mut [f32], Activation),
    Take(&'a mut dyn FnMut(usize, usize, &[f32; FLOAT_PANEL])),
}

/// The matrix product of a layer with a line, for any vectors.
struct Products<'a> {
    layer: &'a FloatLayer,
    rows: &'a [&'a [f32]],
    count: usize,
    panels: &'a dyn Fn(Range<usize>) -> Range<usize>,
    sums: Use<'a>,
}

impl FloatTask for Products<'_> {
    #[inline(always)]
    fn run<V: FloatVectors, const POSITIONS: usize, const VECTORS: usize>(self, vectors: V) {
        let Products { layer, rows, count, panels, sums: mut used } = self;
        assert_eq!(rows.len(), layer.side, "the rows of a layer");
        let length = layer.side * layer.channels;
        let reach = (POSITIONS - 1) * layer.channels + length;
        // A line shorter than a tile is padded.
        let padded: Vec<Vec<f32>>;
        let padded_rows: Vec<&[f32]>;
        let mut rows = rows;
        if count < POSITIONS {
            padded = rows.iter().map(|row| row.iter().copied().chain(iter::repeat(0.0)).take(reach).collect()).collect();
            padded_rows = padded.iter().map(Vec::as_slice).collect();
            rows = &padded_rows;
        }
        let mut sums = [FloatLine([0.0; FLOAT_PANEL]); POSITIONS];
        let mut done = 0;
        while done < count {
            // The last tile overlaps the one before, rather than reaching beyond the end.
            let first = done.min(count.saturating_sub(POSITIONS));
            let end = count.min(first + POSITIONS);
            for panel in panels(done..end) {
                // A stride that the compiler knows takes no instructions: those of MC-CNN.
                match layer.channels {
                    1 => layer.tile::<V, POSITIONS, VECTORS>(vectors, rows, first, 1, panel, &mut sums),
                    64 => layer.tile::<V, POSITIONS, VECTORS>(vectors, rows, first, 64, panel, &mut sums),
                    112 => layer.tile::<V, POSITIONS, VECTORS>(vectors, rows, first, 112, panel, &mut sums),
                    384 => layer.tile::<V, POSITIONS, VECTORS>(vectors, rows, first, 384, panel, &mut sums),
                    stride => layer.tile::<V, POSITIONS, VECTORS>(vectors, rows, first, stride, panel, &mut sums),
                }
                let output = panel * FLOAT_PANEL;
                for (position, sums) in (done..end).zip(&sums[done - first..]) {
                    match &mut used {
                        Use::Store(out, activation) => {
                            let out = &mut out[position * layer.outputs..][output..layer.outputs];
                            match activation {
                                Activation::Linear => out.iter_mut().zip(sums.0).for_each(|(out, sum)| *out = sum),
                                Activation::Relu => out.iter_mut().zip(sums.0).for_each(|(out, sum)| *out = sum.max(0.0)),
                            }
                        }
                        Use::Take(take) => take(position, output, &sums.0),
                    }
                }
            }
            done = end;
        }
    }
}

impl FloatLayer {
    /// Computes the sums of a panel at the positions from `first` on.
    #[inline(always)]
    fn tile<V: FloatVectors, const POSITIONS: usize, const VECTORS: usize>(
        &self,
        vectors: V,
        rows: &[&[f32]],
        first: usize,
        stride: usize,
        panel: usize,
        sums: &mut [FloatLine; POSITIONS],
    ) {
        let length = self.side * stride;
        let weights = &self.weights[panel * self.inputs()..][..self.inputs()];
        for part in 0..FLOAT_PANEL / V::LANES / VECTORS {
            let load = |line: &FloatLine| -> [V::Vector; VECTORS] { array::from_fn(|i| vectors.load(line, part * VECTORS + i)) };
            let mut accumulators = [load(&self.biases[panel]); POSITIONS];
            for (row, weights) in rows.iter().zip(weights.chunks_exact(length)) {
                let row = &row[first * stride..][..(POSITIONS - 1) * stride + length];
                // The inputs at all positions that have a weight in common.
                for (inputs, weights) in row.windows((POSITIONS - 1) * stride + 1).zip(weights) {
                    let weights = load(weights);
                    for (position, accumulators) in accumulators.iter_mut().enumerate() {
                        let input = inputs[position * stride];
                        for (sums, weights) in accumulators.iter_mut().zip(weights) {
                            *sums = vectors.add(*sums, input, weights);
                        }
                    }
                }
            }
            for (sums, accumulators) in sums.iter_mut().zip(accumulators) {
                for (i, accumulator) in accumulators.into_iter().enumerate() {
                    vectors.store(accumulator, sums, part * VECTORS + i);
                }
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

    /// The outputs of the layer by `instructions`, for the panels that `panels` names.
    fn outputs(
        instructions: FloatSums,
        layer: &FloatLayer,
        rows: &[&[f32]],
        count: usize,
        panels: &dyn Fn(Range<usize>) -> Range<usize>,
    ) -> Vec<f32> {
        let mut out = vec![f32::NAN; count * layer.outputs];
        let mut take = |position: usize, first: usize, sums: &[f32; FLOAT_PANEL]| {
            let out = &mut out[position * layer.outputs..][first..layer.outputs];
            for (out, sum) in out.iter_mut().zip(sums) {
                assert!(out.is_nan(), "position {position} comes once");
                *out = *sum;
            }
        };
        instructions.run(Products { layer, rows, count, panels, sums: Use::Take(&mut take) });
        out
    }

    /// Compares a random layer with direct sums in `f64`, and all vectors that fuse with each other.
    fn check(side: usize, channels: usize, outputs: usize, count: usize, seed: &mut u32) {
        let inputs = side * side * channels;
        let mut values = |count: usize| -> Vec<f32> { (0..count).map(|_| random(seed)).collect() };
        let (weights, biases) = (values(inputs * outputs), values(outputs));
        let rows: Vec<Vec<f32>> = (0..side).map(|_| values((count - 1 + side) * channels)).collect();
        let rows: Vec<&[f32]> = rows.iter().map(Vec::as_slice).collect();
        let layer = FloatLayer::new(side, channels, &biases, |input, output| weights[output * inputs + input]);

        let mut widest = vec![0.0; count * outputs];
        layer.apply(&rows, count, Activation::Linear, &mut widest);
        let last = outputs.div_ceil(FLOAT_PANEL) - 1;
        for instructions in FloatSums::available() {
            let found = self::outputs(instructions, &layer, &rows, count, &|_| 0..last + 1);
            for (i, (&found, &widest)) in found.iter().zip(&widest).enumerate() {
                let (position, output) = (i / outputs, i % outputs);
                let seen = rows.iter().flat_map(|row| &row[position * channels..][..side * channels]);
                let products = seen.zip(&weights[output * inputs..]).map(|(&x, &w)| f64::from(x) * f64::from(w));
                let expected = f64::from(biases[output]) + products.sum::<f64>();
                let error = (f64::from(found) - expected).abs();
                assert!(
                    error < 1e-7 * (inputs as f64 + 1.0),
                    "{instructions}: {found} instead of {expected} at {position}, {output}"
                );
                assert!(found == widest || instructions.to_string() == "plain", "{instructions}, {i}");
            }
            let part = self::outputs(instructions, &layer, &rows, count, &|_| last..last + 1);
            for (i, (part, found)) in part.iter().zip(&found).enumerate() {
                assert!(if i % outputs < last * FLOAT_PANEL { part.is_nan() } else { part == found }, "{instructions}, {i}");
            }
        }

        let mut relu = vec![f32::NAN; count * outputs];
        layer.apply(&rows, count, Activation::Relu, &mut relu);
        assert!(relu.iter().zip(&widest).all(|(&relu, &linear)| relu == linear.max(0.0)));
    }

    #[test]
    fn layers_of_any_size_are_direct_sums() {
        let mut seed = 1;
        for count in [1, 2, 5, 6, 7, 13, 14, 15, 28, 33] {
            check(3, 1, 64, count, &mut seed);
            check(1, 64, 31 + count, count, &mut seed);
            check(1, 112, 384, count, &mut seed);
            check(3, 5, 40, count, &mut seed);
        }
        check(3, 64, 64, 17, &mut seed);
        check(3, 112, 112, 9, &mut seed);
        check(1, 384, 384, 15, &mut seed);
    }
}
