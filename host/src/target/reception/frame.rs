//! A received frame.

use crate::images::{DisparityMap, Raster};

/// A frame of disparities as it was received.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedFrame {
    /// The disparities. Pixels that were not received are invalid.
    pub disparities: DisparityMap,
    /// The confidences of the disparities, if packets carried some: the probability that a disparity is at most one pixel off,
    /// times 255. Pixels that were received without are 0, as are those that were not received.
    pub confidences: Option<Raster<u8>>,
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
