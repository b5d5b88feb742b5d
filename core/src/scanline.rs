//! The sources of pixels.

use crate::{Disparity, Frame};

/// A source of scanlines, such as memory, flash, a file, a decompressor, a UART or a sensor.
///
/// The matcher reads every line of each frame once, in ascending order, and never further ahead than
/// [`Params::lead`](crate::Params::lead) states, so a source need not be able to go back. Lines of different
/// frames interleave.
pub trait ScanlineSource {
    /// The reason why a line could not be read.
    type Error;

    /// Fills `line`, whose length is the width of the frame, with the 8-bit grey pixels of line `v` of
    /// `frame`.
    ///
    /// # Errors
    /// The source's own. The matcher returns it, and reads the same line when it is called again.
    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error>;

    /// Fills `line`, whose length is the width of the frame, with line `v` of the disparities around which is searched:
    /// see [`Params::around`](crate::Params::around). They are read as the lines of the centre are. A source of a
    /// search without a prior need not define this: it has none.
    ///
    /// # Errors
    /// As [`read_line`](ScanlineSource::read_line).
    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Self::Error> {
        let _ = v;
        line.fill(None);
        Ok(())
    }
}

/// A source that can be read more than once, as matching in column tiles or in bands of lines requires.
///
/// Each pass over a [`Region`](crate::Region) reads in ascending order, beginning with the first line that
/// the region needs.
pub trait Rewind: ScanlineSource {
    /// Goes back, so that the next lines read may be earlier ones.
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

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), S::Error> {
        (**self).read_prior(v, line)
    }
}
