//! From scanlines to bytes.

use core::{error, fmt};
use embedded_io::Write;
use multiscopic_core::{Disparity, MatchError, Matcher, MemoryTooSmall, Params, ScanlineSource};

/// The memory of a pipeline. Its lengths follow from the parameters.
pub struct Workspace<const WORDS: usize, const WIDTH: usize> {
    matcher: [u32; WORDS],
    line: [Option<Disparity>; WIDTH],
    pixels: [[u8; 2]; WIDTH],
}

impl<const WORDS: usize, const WIDTH: usize> Workspace<WORDS, WIDTH> {
    /// A workspace for `params`. A constant of it is checked when it is compiled.
    pub const fn new(params: &Params) -> Self {
        assert!(WORDS == params.memory_words(), "WORDS must be Params::memory_words()");
        assert!(WIDTH == params.width(), "WIDTH must be Params::width()");
        Workspace { matcher: [0; WORDS], line: [None; WIDTH], pixels: [[0; 2]; WIDTH] }
    }

    /// Matches the frames of `source` and writes each disparity line to `output` as soon as it is there: a pixel in two bytes,
    /// little-endian, as [`Disparity::to_raw16`] encodes it. Returns the number of lines.
    ///
    /// # Errors
    /// Those of the source, the matcher and the output.
    pub fn run<S: ScanlineSource, W: Write>(
        &mut self,
        params: &Params,
        source: &mut S,
        output: &mut W,
    ) -> Result<usize, PipelineError<S::Error, W::Error>> {
        let mut matcher = Matcher::new(params, &mut self.matcher).map_err(PipelineError::Memory)?;
        let mut lines = 0;
        while matcher.next_line(source, &mut self.line).map_err(PipelineError::Match)?.is_some() {
            for (bytes, pixel) in self.pixels.iter_mut().zip(self.line) {
                *bytes = Disparity::to_raw16(pixel).to_le_bytes();
            }
            output.write_all(self.pixels.as_flattened()).map_err(PipelineError::Write)?;
            lines += 1;
        }
        Ok(lines)
    }
}

/// Why a pipeline ended before its last line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PipelineError<S, W> {
    /// The workspace is for other parameters.
    Memory(MemoryTooSmall),
    /// A line could not be matched.
    Match(MatchError<S>),
    /// A line could not be written.
    Write(W),
}

impl<S: fmt::Display, W: fmt::Display> fmt::Display for PipelineError<S, W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PipelineError::Memory(error) => write!(f, "{error}"),
            PipelineError::Match(error) => write!(f, "{error}"),
            PipelineError::Write(error) => write!(f, "cannot write a disparity line: {error}"),
        }
    }
}

impl<S: error::Error, W: error::Error> error::Error for PipelineError<S, W> {}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;
    use multiscopic_core::{Frame, Fusion, Views};

    const PARAMS: Params = match Params::new(24, 20, Views::ALL, Fusion::Heuristic, 1, 4, 3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

    /// A slope two pixels away from the infinite.
    struct Slope;

    impl ScanlineSource for Slope {
        type Error = Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
            let (du, dv) = match frame {
                Frame::Center => (0, 0),
                Frame::View(view) if view.is_horizontal() => (2 * view.sign(), 0),
                Frame::View(view) => (0, 2 * view.sign()),
            };
            for (pixel, u) in line.iter_mut().zip(0..) {
                *pixel = (20 + 3 * (u - du) + 5 * (v as i32 - dv)) as u8;
            }
            Ok(())
        }
    }

    #[test]
    fn every_line_comes_out_encoded() {
        let mut workspace = Workspace::<{ PARAMS.memory_words() }, { PARAMS.width() }>::new(&PARAMS);
        let mut bytes = [0; 2 * PARAMS.width() * PARAMS.height()];
        let mut output = &mut bytes[..];
        assert_eq!(workspace.run(&PARAMS, &mut Slope, &mut output), Ok(PARAMS.height()));
        assert!(output.is_empty());
        let middle = 2 * (PARAMS.height() / 2 * PARAMS.width() + PARAMS.width() / 2);
        assert_eq!(bytes[middle..][..2], (2 * 64 + 32768_u16).to_le_bytes());
    }

    #[test]
    fn an_output_that_is_full_ends_it() {
        let mut workspace = Workspace::<{ PARAMS.memory_words() }, { PARAMS.width() }>::new(&PARAMS);
        let end = workspace.run(&PARAMS, &mut Slope, &mut &mut [0; 2 * PARAMS.width()][..]);
        assert_eq!(end, Err(PipelineError::Write(embedded_io::SliceWriteError::Full)));
    }
}
