//! Images addressed between pixels, and the displacements of a rectification, from a function.

use image::{GrayImage, ImageBuffer, Pixel, Primitive};
use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification};
use rayon::prelude::*;

use super::picture::Picture;

/// The pole of the filter that turns pixels into the coefficients of a cubic spline.
const POLE: f64 = -0.267_949_192_431_122_7;
/// The number of pixels after which its response is gone.
const REACH: usize = 24;

/// The grey value at whole coordinates of an image that is extended beyond its borders by replication.
pub fn extended_pixel(image: &GrayImage, u: isize, v: isize) -> f64 {
    let size = [image.width(), image.height()].map(|side| side as usize);
    f64::from(image.as_raw()[nearest(size, u, v)])
}

/// The index of the pixel of an image that is nearest to a place inside or outside.
fn nearest([width, height]: [usize; 2], u: isize, v: isize) -> usize {
    let [u, v] = [(u, width), (v, height)].map(|(at, size)| at.clamp(0, size as isize - 1) as usize);
    v * width + u
}

/// A grey image between whose pixels a cubic spline runs (Unser, 1999). Its coefficients are replicated beyond its borders.
pub struct InterpolatedImage {
    size: [usize; 2],
    /// Those of the spline's basis functions, one a pixel.
    coefficients: Vec<f64>,
}

impl InterpolatedImage {
    pub fn new(image: &GrayImage) -> InterpolatedImage {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mut coefficients: Vec<f64> = image.as_raw().iter().copied().map(f64::from).collect();
        coefficients.par_chunks_exact_mut(width).for_each(filter);
        let mut columns: Vec<f64> = (0..width).flat_map(|u| coefficients.iter().skip(u).step_by(width).copied()).collect();
        columns.par_chunks_exact_mut(height).for_each(filter);
        let coefficients = (0..height).flat_map(|v| columns.iter().skip(v).step_by(height).copied()).collect();
        InterpolatedImage { size: [width, height], coefficients }
    }

    /// The grey value at `(u, v)`.
    pub fn at(&self, [u, v]: [f64; 2]) -> f64 {
        let [(u, wu), (v, wv)] = [u, v].map(place);
        (-1..).zip(wv).map(|(j, w)| w * self.in_row(v + j, u, wu)).sum()
    }

    /// The grey value at `(u, v)`, and how fast it grows to the right and down, in grey levels per pixel.
    pub fn with_gradient(&self, [u, v]: [f64; 2]) -> [f64; 3] {
        let [(column, wu), (row, wv)] = [u, v].map(place);
        let [su, sv] = [u, v].map(|at| spline_slopes(at - at.floor()));
        let mut found = [0.0; 3];
        for ((y, w), slope) in (row - 1..).zip(wv).zip(sv) {
            let four = self.four(y, column);
            let [value, growth] = [wu, su].map(|weights| weighted(weights, four));
            found[0] += w * value;
            found[1] += w * growth;
            found[2] += slope * value;
        }
        found
    }

    /// The grey values of the square around `(u, v)`, `radius` to each side, in rows.
    pub fn square(&self, [u, v]: [f64; 2], radius: isize) -> Vec<f64> {
        let [(u, wu), (v, wv)] = [u, v].map(place);
        let row = |v: isize| (u - radius..=u + radius).map(|u| self.in_row(v, u, wu)).collect();
        let rows: Vec<Vec<f64>> = (v - radius - 1..=v + radius + 2).map(row).collect();
        let column = |rows: &[Vec<f64>], k: usize| rows.iter().zip(wv).map(|(row, w)| w * row[k]).sum::<f64>();
        let side = (2 * radius + 1) as usize;
        rows.windows(4).flat_map(|rows| (0..side).map(move |k| column(rows, k))).collect()
    }

    /// The weighted sum of the coefficients from `u - 1` on in row `v`.
    fn in_row(&self, v: isize, u: isize, weights: [f64; 4]) -> f64 {
        weighted(weights, self.four(v, u))
    }

    /// The four coefficients from `u - 1` on in row `v`.
    fn four(&self, v: isize, u: isize) -> [f64; 4] {
        let [width, height] = self.size.map(|side| side as isize);
        if u >= 1 && u + 2 < width && (0..height).contains(&v) {
            let first = (v * width + u - 1) as usize;
            return std::array::from_fn(|i| self.coefficients[first..first + 4][i]);
        }
        std::array::from_fn(|i| self.coefficients[nearest(self.size, u + i as isize - 1, v)])
    }
}

fn weighted(weights: [f64; 4], coefficients: [f64; 4]) -> f64 {
    weights.into_iter().zip(coefficients).map(|(weight, coefficient)| weight * coefficient).sum()
}

/// The pixel at or before a coordinate, and the weights of four coefficients from the one before it on.
fn place(at: f64) -> (isize, [f64; 4]) {
    (at.floor() as isize, spline_weights(at - at.floor()))
}

/// Turns a line of pixels, which goes on as in a mirror at its ends, into coefficients of a cubic spline.
fn filter(line: &mut [f64]) {
    let last = line.len() - 1;
    if last == 0 {
        return;
    }
    let mirrored = |k: usize| {
        let k = k % (2 * last);
        k.min(2 * last - k)
    };
    // Forwards, and then backwards.
    line[0] = (0..REACH).map(|k| POLE.powi(k as i32) * line[mirrored(k)]).sum();
    for k in 1..=last {
        line[k] += POLE * line[k - 1];
    }
    line[last] = POLE / (POLE * POLE - 1.0) * (line[last] + POLE * line[last - 1]);
    for k in (0..last).rev() {
        line[k] = POLE * (line[k + 1] - line[k]);
    }
    line.iter_mut().for_each(|at| *at *= 6.0);
}

/// The weights of four consecutive coefficients for a position `t` beyond the second, with `t` from 0 to 1.
fn spline_weights(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s.powi(3), 4.0 - 6.0 * t * t + 3.0 * t.powi(3), 4.0 - 6.0 * s * s + 3.0 * s.powi(3), t.powi(3)].map(|weight| weight / 6.0)
}

/// The derivatives of the [weights](spline_weights).
fn spline_slopes(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [-s * s, -4.0 * t + 3.0 * t * t, 4.0 * s - 3.0 * s * s, t * t].map(|slope| slope / 2.0)
}

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

/// The displacements of a frame at the nodes of a grid, sampled from the function that says where rectified pixels are found.
///
/// ```
/// use multiscopic::images::SampledDisplacements;
/// use multiscopic_core::DisplacementGrid;
///
/// // The camera is turned by 1 degree about the optical axis, through pixel (80, 60).
/// let (sin, cos) = 1_f64.to_radians().sin_cos();
/// let source_of = |[u, v]: [f64; 2]| [80.0 + cos * (u - 80.0) - sin * (v - 60.0), 60.0 + sin * (u - 80.0) + cos * (v - 60.0)];
/// let grid = DisplacementGrid::new(160, 120, 32).unwrap();
/// assert!(SampledDisplacements::new(grid, source_of).max_error() < 1.0 / 32.0);
/// ```
#[derive(Clone, Debug)]
pub struct SampledDisplacements {
    grid: DisplacementGrid,
    nodes: Vec<Displacement>,
    max_error: f64,
}

impl SampledDisplacements {
    /// The displacements at the nodes of `grid`. `source_of` has the column and the row of a rectified pixel, and returns those
    /// at which it is found in the source. It is called for nodes outside the frame as well.
    ///
    /// Displacements are limited to what a [`Displacement`] can hold; [`max_error`](SampledDisplacements::max_error) shows
    /// whether that matters.
    pub fn new(grid: DisplacementGrid, source_of: impl Fn([f64; 2]) -> [f64; 2]) -> SampledDisplacements {
        let steps = f64::from(Displacement::STEPS);
        let node = |k: usize| {
            let pixel = [k % grid.columns(), k / grid.columns()].map(|index| (index * grid.spacing()) as f64);
            let source = source_of(pixel);
            // The conversion saturates.
            let [right, down] = [0, 1].map(|axis| (steps * (source[axis] - pixel[axis])).round() as i16);
            Displacement { right, down }
        };
        let nodes: Vec<_> = (0..grid.nodes()).map(node).collect();
        let sampled = SampledDisplacements { grid, nodes, max_error: 0.0 };
        let rectification = sampled.rectification();
        let last = [grid.width() - 1, grid.height() - 1].map(|last| last as f64);
        let error = |(u, v): (usize, usize)| {
            let source = source_of([u as f64, v as f64]);
            let (right, down) = rectification.position(Frame::Center, (u, v));
            // An undefined coordinate remains so.
            let [column, row] = [0, 1].map(|axis| source[axis].clamp(0.0, last[axis]));
            let error = (f64::from(right) / steps - column).hypot(f64::from(down) / steps - row);
            if error.is_nan() { f64::INFINITY } else { error }
        };
        let pixels = (0..grid.height()).flat_map(|v| (0..grid.width()).map(move |u| (u, v)));
        let max_error = pixels.map(error).fold(0.0, f64::max);
        SampledDisplacements { max_error, ..sampled }
    }

    /// The displacements, as [`Rectification::new`] takes them.
    pub fn nodes(&self) -> &[Displacement] {
        &self.nodes
    }

    /// The largest distance in pixels, over all pixels of the frame, between where they are found by the function and by
    /// interpolation between the nodes. Both are limited to the frame, whose outermost pixels are repeated.
    ///
    /// It is infinite if the function is undefined at a pixel. Halving the spacing divides what comes from interpolation by
    /// about four; up to 1/45 pixel comes from rounding.
    pub fn max_error(&self) -> f64 {
        self.max_error
    }

    /// The rectification of frames that share these displacements.
    pub fn rectification(&self) -> Rectification<'_> {
        Rectification::new(self.grid, &self.nodes, &[]).expect("a displacement was sampled at each node")
    }
}

#[cfg(test)]
mod tests {
    use image::Luma;
    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn borders_are_replicated() {
        let image = GrayImage::from_fn(4, 3, |u, v| Luma([(10 * v + u) as u8]));
        assert_eq!([extended_pixel(&image, 3, 1), extended_pixel(&image, 9, -5)], [13.0, 3.0]);
    }

    #[test]
    fn waves_are_shifted_exactly() {
        // A period of six pixels: cubic convolution would shift it by 13 % too little.
        let wave = |u: f64| 128.0 + 100.0 * (u * std::f64::consts::TAU / 6.0).sin();
        let image = GrayImage::from_fn(60, 5, |u, _| Luma([wave(f64::from(u)).round() as u8]));
        let image = InterpolatedImage::new(&image);
        for u in 20..40 {
            let u = f64::from(u) + 0.1;
            assert!((image.at([u, 2.0]) - wave(u)).abs() < 1.5, "{u}");
        }
    }

    /// The cubic B-spline, in the form of Unser's equation 4.
    fn basis(distance: f64) -> f64 {
        let x = distance.abs();
        match x {
            0.0..1.0 => 2.0 / 3.0 - x * x * (2.0 - x) / 2.0,
            1.0..2.0 => (2.0 - x).powi(3) / 6.0,
            _ => 0.0,
        }
    }

    /// The spline through the pixels, whose coefficients solve linear equations. All go on as in a mirror.
    fn spline(image: &GrayImage, at: [f64; 2]) -> f64 {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mirrored = |k: isize, size: usize| {
            let period = 2 * (size as isize - 1);
            let k = k.rem_euclid(period);
            k.min(period - k) as usize
        };
        let weights = |[x, y]: [f64; 2]| {
            let mut weights = DVector::zeros(width * height);
            for (v, u) in (-4..height as isize + 4).flat_map(|v| (-4..width as isize + 4).map(move |u| (v, u))) {
                weights[mirrored(v, height) * width + mirrored(u, width)] += basis(x - u as f64) * basis(y - v as f64);
            }
            weights
        };
        let rows: Vec<_> = (0..width * height).map(|k| weights([(k % width) as f64, (k / width) as f64]).transpose()).collect();
        let pixels = DVector::from_iterator(width * height, image.as_raw().iter().copied().map(f64::from));
        let coefficients = DMatrix::from_rows(&rows).lu().solve(&pixels).unwrap();
        weights(at).dot(&coefficients)
    }

    #[test]
    fn a_square_is_that_of_the_spline_through_the_pixels() {
        let image = GrayImage::from_fn(11, 9, |u, v| Luma([(u * u * 37 + v * 53 + u * v * 11) as u8]));
        let interpolated = InterpolatedImage::new(&image);
        for (u, v) in [(4.0, 4.0), (5.3, 3.8), (4.6, 4.9)] {
            let mut values = interpolated.square([u, v], 2).into_iter();
            for (j, i) in (-2..=2).flat_map(|j| (-2..=2).map(move |i| (j, i))) {
                let at = [u + f64::from(i), v + f64::from(j)];
                let [found, expected] = [values.next().unwrap(), spline(&image, at)];
                assert!((found - expected).abs() < 1e-6 && (interpolated.at(at) - expected).abs() < 1e-6, "{at:?}");
            }
            assert_eq!(values.next(), None);
        }
    }

    fn grid(spacing: u8) -> DisplacementGrid {
        DisplacementGrid::new(160, 120, spacing).unwrap()
    }

    #[test]
    fn shifts_are_rounded_to_steps() {
        let sampled = SampledDisplacements::new(grid(16), |[u, v]| [u + 3.25, v - 1.5]);
        assert_eq!(sampled.nodes(), [Displacement { right: 208, down: -96 }; 99]);
        assert_eq!(sampled.max_error(), 0.0);
        assert_eq!(SampledDisplacements::new(grid(16), |[u, v]| [u + 1.0 / 256.0, v]).max_error(), 1.0 / 256.0);
    }

    #[test]
    fn what_displacements_cannot_say_is_an_error() {
        let wide = DisplacementGrid::new(2000, 10, 16).unwrap();
        let mirrored = SampledDisplacements::new(wide, |[u, v]| [1999.0 - u, v]);
        assert!(mirrored.max_error() > 1000.0, "{}", mirrored.max_error());
        assert_eq!(SampledDisplacements::new(wide, |[u, v]| [(100.0 - u).sqrt(), v]).max_error(), f64::INFINITY);
    }

    #[test]
    fn the_error_of_a_lens_falls_with_the_square_of_the_spacing() {
        // k1 = -0.25 at a focal length of 160 pixels.
        let lens = |[u, v]: [f64; 2]| {
            let (x, y) = ((u - 79.5) / 160.0, (v - 59.5) / 160.0);
            let scale = 1.0 - 0.25 * (x * x + y * y);
            [79.5 + 160.0 * scale * x, 59.5 + 160.0 * scale * y]
        };
        // Between nodes, the error is the second derivative times the square of the spacing over eight.
        let bend = 6.0 * 0.25 * 80.0 / (160.0 * 160.0);
        for spacing in [32, 16, 8, 4] {
            let error = SampledDisplacements::new(grid(spacing), lens).max_error();
            let largest = bend * f64::from(spacing).powi(2) / 8.0;
            assert!(error < 2.0 * largest + 1.0 / 45.0, "{spacing}: {error}, {largest}");
            assert!(spacing < 16 || error > largest / 2.0, "{spacing}: {error}, {largest}");
        }
    }
}
