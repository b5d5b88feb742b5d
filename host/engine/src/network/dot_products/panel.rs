//! Panels of outputs whose sums are computed together.

/// The outputs of a wide panel.
pub const PANEL: usize = 16;

/// The weights from 4 inputs to the outputs of a panel, output by output, aligned to the widest vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub struct WeightLine(pub [i8; 4 * PANEL]);

/// Instructions for the sums of the first [`OUTPUTS`](Panel::OUTPUTS) outputs of a panel.
pub trait Panel: Copy {
    /// 8 or 16.
    const OUTPUTS: usize;
    /// The sums of one position.
    type Sums: Copy;
    /// The weights from 4 inputs.
    type Weights: Copy;

    /// Sums of these values.
    fn load(self, sums: &[i32; PANEL]) -> Self::Sums;

    /// Writes the sums.
    fn store(self, sums: Self::Sums, out: &mut [i32; PANEL]);

    /// The weights of the outputs.
    fn weights(self, line: &WeightLine) -> Self::Weights;

    /// Adds the products of 4 inputs, each at most 127, with their weights.
    fn add(self, sums: Self::Sums, inputs: [u8; 4], weights: Self::Weights) -> Self::Sums;
}

/// A computation that is generic over panels.
pub trait PanelTask {
    /// Computes it with wide panels for `WIDE` positions at a time, and narrow ones for `NARROW`.
    fn run<W: Panel, N: Panel, const WIDE: usize, const NARROW: usize>(self, wide: W, narrow: N);
}
