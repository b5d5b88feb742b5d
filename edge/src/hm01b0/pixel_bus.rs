//! The parallel bus of a sensor.

/// Lines of a sensor as they come over its bus: from an interrupt through a [`LineQueue`](super::LineQueue), or straight from a peripheral
/// that holds a few.
pub trait PixelBus {
    /// Gives up the frame that is being received: what comes next is the first line of a frame that begins after this call.
    fn restart(&mut self);

    /// The next line, or the end of the frame; none if neither has come yet. It does not wait.
    fn next(&mut self) -> Option<Arrival<'_>>;
}

/// What comes over the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival<'a> {
    /// A line.
    Line {
        /// Its number in the frame, from 0, counting those that were lost.
        number: usize,
        /// Its pixels.
        pixels: &'a [u8],
    },
    /// The frame has ended.
    End {
        /// The number of its lines, counting those that were lost.
        lines: usize,
    },
}
