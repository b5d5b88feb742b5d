//! The sources of pixels, and their gradients, which the brightness of a view does not change.

use crate::{Disparity, Frame};

/// A source of scanlines, such as memory, flash, a file, a decompressor, a UART or a sensor.
///
/// The matcher reads every line of each frame once, in ascending order, and never further ahead than
/// [`BlockMatchingParams::lead`](crate::BlockMatchingParams::lead) states, so a source need not be able to
/// go back. Lines of different frames interleave.
///
/// ```
/// use multiscopic_core::{Frame, ScanlineSource, Views};
///
/// /// Frames of `width` x `height` pixels in memory: the centre, then the views in their order.
/// struct Stored<'a> {
///     pixels: &'a [u8],
///     width: usize,
///     height: usize,
///     views: Views,
/// }
///
/// impl ScanlineSource for Stored<'_> {
///     type Error = &'static str;
///
///     fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let index = match frame {
///             Frame::Center => 0,
///             Frame::View(view) => 1 + self.views.iter().position(|stored| stored == view).ok_or("no such view")?,
///         };
///         let start = (index * self.height + v) * self.width;
///         line.copy_from_slice(self.pixels.get(start..start + self.width).ok_or("no such line")?);
///         Ok(())
///     }
/// }
///
/// let mut source = Stored { pixels: &[1, 2, 3, 4, 5, 6, 7, 8], width: 2, height: 2, views: Views::STEREO };
/// let mut line = [0; 2];
/// source.read_line(Frame::Center, 1, &mut line)?;
/// assert_eq!(line, [3, 4]);
/// # Ok::<(), &str>(())
/// ```
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
    /// see [`BlockMatchingParams::around`](crate::BlockMatchingParams::around). They are read as the lines of the
    /// centre are. A source of a search without a prior need not define this: it has none.
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

/// The gradients of another source: of each pixel, half the difference of its neighbours in the line, rounded down,
/// plus 128. At the ends of a line the pixel itself takes the place of the neighbour that is missing.
///
/// Views several baselines away differ in brightness from the centre, more than shapes do around a [prior]. Over a
/// whole search range gradients are worse than grey values: they are more ambiguous.
///
/// [prior]: crate::BlockMatchingParams::around
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
    use core::convert::Infallible;

    use super::*;

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
