//! Gradients along the lines, which the brightness of a view does not change.

use crate::{Disparity, Frame, Rewind, ScanlineSource};

/// The gradients of another source: of each pixel, half the difference of its neighbours in the line, rounded down,
/// plus 128. At the ends of a line the pixel itself takes the place of the neighbour that is missing.
///
/// Views several baselines away differ in brightness from the centre, more than shapes do around a [prior]. Over a
/// whole search range gradients are worse than grey values: they are more ambiguous.
///
/// [prior]: crate::Params::around
///
/// ```
/// use multiscopic_core::{Frame, Gradients, ScanlineSource};
///
/// struct Step;
///
/// impl ScanlineSource for Step {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, _frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         line.copy_from_slice(&[10, 10, 30, 255]);
///         Ok(())
///     }
/// }
///
/// let mut line = [0; 4];
/// Gradients(Step).read_line(Frame::Center, 0, &mut line)?;
/// assert_eq!(line, [128, 138, 250, 240]);
/// # Ok::<(), core::convert::Infallible>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Gradients<S>(pub S);

impl<S: ScanlineSource> ScanlineSource for Gradients<S> {
    type Error = S::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        self.0.read_line(frame, v, line)?;
        let mut before = line.first().copied().unwrap_or_default();
        for u in 0..line.len() {
            let after = line.get(u + 1).or(line.get(u)).copied().unwrap_or_default();
            if let Some(pixel) = line.get_mut(u) {
                let gradient = (i16::from(after) - i16::from(before)) >> 1;
                before = *pixel;
                *pixel = (gradient + 128) as u8;
            }
        }
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), S::Error> {
        self.0.read_prior(v, line)
    }
}

impl<S: Rewind> Rewind for Gradients<S> {
    fn rewind(&mut self) -> Result<(), S::Error> {
        self.0.rewind()
    }
}
