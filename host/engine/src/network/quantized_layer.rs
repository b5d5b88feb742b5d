//! A layer in whole numbers: sums of products, brought back to the scale of activations.

use multiscopic_core::network::{LayerRecord, QuantizedOutput};

use super::dot_products::{DotProducts, PANEL, Panel, PanelTask, WeightLine};

/// The inputs of a layer that lie side by side in memory, in runs of equal length.
///
/// Those of a position lie `stride` bytes behind those of the position before. A convolution of 3x3 pixels has three
/// runs, one for each row, of three pixels; the runs of neighbouring positions overlap.
#[derive(Clone, Copy, Debug)]
pub struct Runs<'a, const RUNS: usize> {
    /// The input bytes from the start of each run of the first position on.
    pub runs: [&'a [u8]; RUNS],
    /// Bytes from a position to the next, a multiple of 4.
    pub stride: usize,
}

/// A layer with its weights, arranged for [`DotProducts`].
///
/// Outputs are computed in panels of 16. If 8 or fewer are left, the last panel is a narrow one of 8.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantizedLayer {
    run_length: usize,
    outputs: usize,
    panels: Vec<LayerPanel>,
}

#[derive(Clone, Debug, PartialEq)]
struct LayerPanel {
    biases: [i32; PANEL],
    shifts: [i32; PANEL],
    multipliers: [i32; PANEL],
    /// Run by run, 4 inputs in a line.
    weights: Vec<WeightLine>,
}

impl QuantizedLayer {
    /// The layer with these outputs, the `weight` from an input to an output, and inputs in `runs` of `run_length`, a
    /// multiple of 4.
    pub fn new(
        runs: usize,
        run_length: usize,
        outputs: &[QuantizedOutput],
        weight: impl Fn(usize, usize) -> i8,
    ) -> QuantizedLayer {
        assert!(run_length.is_multiple_of(4), "runs of {run_length} inputs");
        let panel = |(panel, outputs): (usize, &[QuantizedOutput])| {
            let each = |value: &dyn Fn(&QuantizedOutput) -> i32| {
                let mut values = [0; PANEL];
                values.iter_mut().zip(outputs).for_each(|(out, output)| *out = value(output));
                values
            };
            let line = |line: usize| {
                WeightLine(std::array::from_fn(|i| {
                    let output = i / 4;
                    if output < outputs.len() { weight(4 * line + i % 4, panel * PANEL + output) } else { 0 }
                }))
            };
            LayerPanel {
                biases: each(&|output| output.bias),
                shifts: each(&|output| output.shift.into()),
                multipliers: each(&|output| output.multiplier.into()),
                weights: (0..runs * run_length / 4).map(line).collect(),
            }
        };
        let panels = outputs.chunks(PANEL).enumerate().map(panel).collect();
        QuantizedLayer { run_length, outputs: outputs.len(), panels }
    }

    /// The layer that a file has.
    pub fn of(record: LayerRecord) -> QuantizedLayer {
        let (weights, outputs): (Vec<_>, Vec<_>) = record.outputs().unzip();
        let runs = weights[0].len() / record.run_length();
        QuantizedLayer::new(runs, record.run_length(), &outputs, |input, output| weights[output][input].cast_signed())
    }

    /// The number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The outputs of a position in [`row`](QuantizedLayer::row): their number rounded up to a multiple of 8.
    pub fn padded_outputs(&self) -> usize {
        self.outputs.next_multiple_of(8)
    }

    /// Computes the outputs at as many positions of a row as `out` has room for, position by position, each padded with
    /// zeros.
    ///
    /// # Panics
    /// If the runs are too short.
    pub fn row<const RUNS: usize>(&self, products: DotProducts, inputs: Runs<RUNS>, out: &mut [i16]) {
        products.run(Row { layer: self, inputs, out });
    }
}

/// A row of outputs.
struct Row<'a, const RUNS: usize> {
    layer: &'a QuantizedLayer,
    inputs: Runs<'a, RUNS>,
    out: &'a mut [i16],
}

impl<const RUNS: usize> PanelTask for Row<'_, RUNS> {
    #[inline(always)]
    fn run<W: Panel, N: Panel, const WIDE: usize, const NARROW: usize>(self, wide: W, narrow: N) {
        let Row { layer, inputs, out } = self;
        let outputs = layer.padded_outputs();
        for (i, panel) in layer.panels.iter().enumerate() {
            let first = i * PANEL;
            if outputs - first > N::OUTPUTS {
                panel.row::<W, WIDE, RUNS>(wide, layer.run_length, inputs, outputs, &mut out[first..]);
            } else {
                panel.row::<N, NARROW, RUNS>(narrow, layer.run_length, inputs, outputs, &mut out[first..]);
            }
        }
    }
}

impl LayerPanel {
    /// Computes the outputs of this panel, of `outputs` at each position, with `POSITIONS` at a time.
    #[inline(always)]
    fn row<P: Panel, const POSITIONS: usize, const RUNS: usize>(
        &self,
        panel: P,
        run_length: usize,
        inputs: Runs<RUNS>,
        outputs: usize,
        out: &mut [i16],
    ) {
        let count = out.len().div_ceil(outputs);
        let mut first = 0;
        while first + POSITIONS <= count {
            self.tile::<P, POSITIONS, RUNS>(panel, run_length, inputs, first, outputs, out);
            first += POSITIONS;
        }
        if first < count && count >= POSITIONS {
            // The last tile overlaps the one before, rather than reaching beyond the end.
            self.tile::<P, POSITIONS, RUNS>(panel, run_length, inputs, count - POSITIONS, outputs, out);
        } else {
            for first in first..count {
                self.tile::<P, 1, RUNS>(panel, run_length, inputs, first, outputs, out);
            }
        }
    }

    #[inline(always)]
    fn tile<P: Panel, const POSITIONS: usize, const RUNS: usize>(
        &self,
        panel: P,
        run_length: usize,
        inputs: Runs<RUNS>,
        first: usize,
        outputs: usize,
        out: &mut [i16],
    ) {
        let lines = run_length / 4;
        let mut sums = [panel.load(&self.biases); POSITIONS];
        for (run, weights) in inputs.runs.iter().zip(self.weights.chunks_exact(lines)) {
            let positions: [&[[u8; 4]]; POSITIONS] =
                std::array::from_fn(|i| &run[(first + i) * inputs.stride..][..run_length].as_chunks::<4>().0[..lines]);
            for (line, weights) in weights.iter().enumerate() {
                let weights = panel.weights(weights);
                for (sums, inputs) in sums.iter_mut().zip(&positions) {
                    *sums = panel.add(*sums, inputs[line], weights);
                }
            }
        }
        for (i, sums) in sums.into_iter().enumerate() {
            let mut values = [0; PANEL];
            panel.store(sums, &mut values);
            let out = &mut out[(first + i) * outputs..][..P::OUTPUTS];
            for (output, out) in out.iter_mut().enumerate() {
                *out = QuantizedOutput::scaled(values[output], self.shifts[output], self.multipliers[output]);
            }
        }
    }
}
