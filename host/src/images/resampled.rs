//! Pictures of which every pixel comes from another place.

use image::{ImageBuffer, Pixel, Primitive};
use rayon::prelude::*;

use super::picture::Picture;

impl Picture {
    /// The picture of the same size and depth whose pixels lie where `map` leads to, black where that is nowhere, divided by
    /// `gain`. They are interpolated by cubic convolution (Keys, 1981) and rounded to nearest, and pixels outside the picture
    /// repeat its border.
    pub fn resampled(&self, map: impl Fn([usize; 2]) -> Option<[f64; 2]> + Sync, gain: f64) -> Picture {
        match self {
            Picture::Gray(image) => Picture::Gray(resampled(image, map, gain)),
            Picture::Rgb(image) => Picture::Rgb(resampled(image, map, gain)),
            Picture::Gray16(image) => Picture::Gray16(resampled(image, map, gain)),
            Picture::Rgb16(image) => Picture::Rgb16(resampled(image, map, gain)),
        }
    }
}

/// The sample of a channel.
trait Sample: Primitive + Into<f64> + Send + Sync {
    /// The sample nearest to a value.
    fn nearest(value: f64) -> Self;
}

impl Sample for u8 {
    fn nearest(value: f64) -> u8 {
        // The conversion clamps.
        value.round() as u8
    }
}

impl Sample for u16 {
    fn nearest(value: f64) -> u16 {
        value.round() as u16
    }
}

fn resampled<P: Pixel<Subpixel: Sample>>(
    image: &ImageBuffer<P, Vec<P::Subpixel>>,
    map: impl Fn([usize; 2]) -> Option<[f64; 2]> + Sync,
    gain: f64,
) -> ImageBuffer<P, Vec<P::Subpixel>> {
    let (width, height, channels) = (image.width() as usize, image.height() as usize, usize::from(P::CHANNEL_COUNT));
    let pixels = image.as_raw();
    let mut out = vec![P::Subpixel::nearest(0.0); pixels.len()];
    out.par_chunks_exact_mut(width * channels).enumerate().for_each(|(v, row)| {
        for (u, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let Some([x, y]) = map([u, v]) else { continue };
            let (columns, across) = taps(x, width);
            let (rows, down) = taps(y, height);
            for (channel, out) in pixel.iter_mut().enumerate() {
                let along = |row: usize| -> f64 {
                    let at = |column: usize| -> f64 { pixels[(row * width + column) * channels + channel].into() };
                    columns.iter().zip(across).map(|(&column, weight)| weight * at(column)).sum()
                };
                let gray: f64 = rows.iter().zip(down).map(|(&row, weight)| weight * along(row)).sum();
                *out = P::Subpixel::nearest(gray / gain);
            }
        }
    });
    ImageBuffer::from_raw(width as u32, height as u32, out).expect("as many pixels as before")
}

/// The four pixels around a coordinate, and their weights.
fn taps(at: f64, size: usize) -> ([usize; 4], [f64; 4]) {
    // Further outside, all four are the border.
    let at = at.clamp(-4.0, size as f64 + 4.0);
    let first = at.floor() as isize - 1;
    ([0, 1, 2, 3].map(|i| (first + i).clamp(0, size as isize - 1) as usize), cubic_weights(at - at.floor()))
}

/// The weights of four consecutive pixels for a position `t` beyond the second, with `t` from 0 to 1.
fn cubic_weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [(-t3 + 2.0 * t2 - t) / 2.0, (3.0 * t3 - 5.0 * t2 + 2.0) / 2.0, (-3.0 * t3 + 4.0 * t2 + t) / 2.0, (t3 - t2) / 2.0]
}
