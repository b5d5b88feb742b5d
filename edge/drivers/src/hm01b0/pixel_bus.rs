//! The parallel bus that a sensor sends its pixels over.

/// Receives the lines of a sensor: from an interrupt, through a [`LineQueue`](crate::hm01b0::LineQueue), or
/// straight from a peripheral that buffers a few.
pub trait PixelBus {
    /// Drops the frame that is being received. The next line begins a frame that started after this call.
    fn restart(&mut self);

    /// The next line or the end of the frame, or nothing if neither has arrived yet. Never blocks.
    fn next(&mut self) -> Option<Arrival<'_>>;
}

/// An event on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival<'a> {
    /// A line.
    Line {
        /// Its number in the frame, from 0. Lost lines count.
        number: usize,
        /// Its pixels.
        pixels: &'a [u8],
    },
    /// The end of the frame.
    End {
        /// The number of its lines. Lost lines count.
        lines: usize,
    },
}
