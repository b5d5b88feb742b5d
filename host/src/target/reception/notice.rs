//! What is reported while packets arrive.

use super::flaw::Flaw;

/// An event during reception.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// A line was received.
    Line {
        /// Number of the frame's pixels received so far.
        pixels: usize,
        /// Number of pixels in the frame.
        of: usize,
    },
    /// A packet did not arrive as it was sent.
    Flaw(Flaw),
}
