//! A received frame.

use crate::images::DisparityMap;

/// A frame of disparities as it was received.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedFrame {
    /// The disparities. Pixels that were not received are invalid.
    pub disparities: DisparityMap,
    /// Number of pixels received.
    pub pixels: usize,
    /// Greatest depth of the sender's stack in bytes, if the sender measures it.
    pub stack: Option<usize>,
}

impl ReceivedFrame {
    /// Whether every pixel was received.
    pub fn is_complete(&self) -> bool {
        self.pixels == self.disparities.pixels().len()
    }
}
