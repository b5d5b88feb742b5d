//! Where the matcher pulls its pixels from.

use crate::Frame;

/// A source of scanlines: memory, flash, a file, a decompressor, a UART, or a sensor.
///
/// The matcher asks for the lines of each frame exactly once and in ascending order, never further ahead than
/// [`Params::lead`](crate::Params::lead) says, so a source need not be able to go back. The frames' turns interleave.
pub trait ScanlineSource {
    /// Why a line could not be had.
    type Error;

    /// Fills `line`, which is as long as the frame is wide, with the 8-bit grey pixels of line `v` of `frame`.
    ///
    /// # Errors
    /// The source's own. The matcher hands the error on and asks for the same line again when it is called again.
    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error>;
}

/// A source that can be read more than once: what matching in column tiles or in bands of lines needs.
///
/// Each pass over a [`Region`](crate::Region) reads in ascending order, from the first line that the region needs.
pub trait Rewind: ScanlineSource {
    /// Goes back, so that the next lines asked for may be earlier ones.
    ///
    /// # Errors
    /// The source's own.
    fn rewind(&mut self) -> Result<(), Self::Error>;
}

impl<S: ScanlineSource + ?Sized> ScanlineSource for &mut S {
    type Error = S::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        (**self).read_line(frame, v, line)
    }
}
