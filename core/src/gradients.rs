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
        let mut first = 0;
        while let Some(&mut [ref mut four @ .., next]) = line.get_mut(first..).and_then(|line| line.first_chunk_mut::<5>()) {
            let pixels = u32::from_le_bytes(*four);
            let after = pixels >> 8 | u32::from(next) << 24;
            *four = gradients(pixels << 8 | u32::from(before), after).to_le_bytes();
            before = (pixels >> 24) as u8;
            first += 4;
        }
        for u in first..line.len() {
            let after = line.get(u + 1).or(line.get(u)).copied().unwrap_or_default();
            if let Some(pixel) = line.get_mut(u) {
                let gradient = gradients(before.into(), after.into()) as u8;
                before = *pixel;
                *pixel = gradient;
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

/// The gradients of four pixels, a byte each, between the pixels `before` and `after` them.
#[inline(always)]
fn gradients(before: u32, after: u32) -> u32 {
    // Half the difference plus 128 is the mean, rounded up, of the pixel after and the inverse of the pixel before. Two
    // bytes have the bits of their sum's half in common, and half of those in which they differ.
    let inverse = !before;
    (after | inverse) - ((after ^ inverse) >> 1 & 0x7f7f_7f7f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;

    struct Line([u8; 23]);

    impl ScanlineSource for Line {
        type Error = Infallible;

        fn read_line(&mut self, _: Frame, _: usize, line: &mut [u8]) -> Result<(), Infallible> {
            line.copy_from_slice(&self.0[..line.len()]);
            Ok(())
        }
    }

    #[test]
    fn lines_of_all_lengths_have_the_gradients_of_the_definition() {
        let mut pixels: [u8; 23] = core::array::from_fn(|u| (u * u * 89 + 7 * u) as u8);
        (pixels[3], pixels[5], pixels[8], pixels[10]) = (0, 255, 255, 0);
        for len in 0..=pixels.len() {
            let mut line = [0; 23];
            Gradients(Line(pixels)).read_line(Frame::Center, 0, &mut line[..len]).unwrap();
            for (u, &gradient) in line.iter().enumerate().take(len) {
                let [before, after] = [u.saturating_sub(1), (u + 1).min(len - 1)].map(|u| f32::from(pixels[u]));
                assert_eq!(f32::from(gradient), ((after - before) / 2.0).floor() + 128.0, "{len}, {u}");
            }
        }
    }
}
