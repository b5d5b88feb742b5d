//! What the firmware asks of a board.

use core::time::Duration;
use embedded_io::Write;
use multiscopic_core::{Params, Rewind};

/// A board: the frames it holds, the way out for disparities, and a clock.
pub trait Board {
    /// The stored frames. They are read by the line and in order, again for each column tile.
    type Frames: Rewind;
    /// Where packets go.
    type Output: Write;
    /// Why the board cannot serve.
    type Error;

    /// The frames to match.
    ///
    /// # Errors
    /// A frame is missing or has another size than `params` say.
    fn frames(&mut self, params: &Params) -> Result<Self::Frames, Self::Error>;

    /// The way out.
    ///
    /// # Errors
    /// There is none.
    fn output(&mut self) -> Result<Self::Output, Self::Error>;

    /// The time since the start.
    fn elapsed(&self) -> Duration;

    /// Marks that the work goes over to another phase: a place for a pin that a scope watches, or for counting.
    fn enter(phase: Phase);
}

/// What the firmware is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Anything else.
    Idle,
    /// Matching.
    Matching,
    /// Fetching a line from the store.
    Fetching,
    /// Encoding and sending a disparity line.
    Sending,
}
