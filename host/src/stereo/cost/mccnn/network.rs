//! The networks, their inputs, and the features of pixels that they compute.

use std::{array, ops::Range};

use image::GrayImage;
use multiscopic_engine::network::{Activation, FloatLayer};
use rayon::prelude::*;

use super::weights::{Architecture, HIDDEN, Weights};
use crate::{error::Result, images::Raster};

/// The radius of the receptive field of features, in pixels.
const BORDER: usize = 5;
/// The most rows whose features are computed at a time. The convolutions compute up to 8 rows more each time,
/// and keep them in memory.
const BAND: usize = 64;

/// An image as the networks see it: normalised to mean 0 and standard deviation 1, and padded by 5 pixels
/// that replicate its border.
#[derive(Clone, Debug)]
pub struct Input {
    width: usize,
    height: usize,
    /// With the padding.
    pixels: Vec<f32>,
}

impl Input {
    /// Normalises and pads an image. If all of its pixels are equal, they become 0.
    pub fn new(image: &GrayImage) -> Input {
        let [width, height] = [image.width(), image.height()].map(|side| side as usize);
        let count = (width * height) as f64;
        let [sum, squares] = image.as_raw().iter().fold([0u64; 2], |[sum, squares], &grey| {
            let grey = u64::from(grey);
            [sum + grey, squares + grey * grey]
        });
        let mean = sum as f64 / count;
        let deviation = (squares as f64 / count - mean * mean).max(0.0).sqrt();
        let scale = if deviation > 0.0 { 1.0 / deviation } else { 1.0 };
        let normalized: [f32; 256] = array::from_fn(|grey| ((grey as f64 - mean) * scale) as f32);

        let inside = |coordinate: usize, size: usize| coordinate.saturating_sub(BORDER).min(size - 1);
        let row = |y: usize| &image.as_raw()[inside(y, height) * width..][..width];
        let pixels = (0..height + 2 * BORDER)
            .flat_map(|y| (0..width + 2 * BORDER).map(move |x| row(y)[inside(x, width)]))
            .map(|grey| normalized[usize::from(grey)])
            .collect();
        Input { width, height, pixels }
    }

    /// Pixels in a row of the image.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the image.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The normalised image without its padding.
    pub fn to_raster(&self) -> Raster<f32> {
        let rows = (BORDER..BORDER + self.height).flat_map(|y| &self.row(y)[BORDER..][..self.width]);
        Raster::new(self.width, self.height, rows.copied().collect())
    }

    /// A row of the padded image.
    fn row(&self, y: usize) -> &[f32] {
        let length = self.width + 2 * BORDER;
        &self.pixels[y * length..][..length]
    }
}

/// The features of the pixels of some rows of an image: `channels` values for each, which describe the patch
/// around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    width: usize,
    channels: usize,
    rows: Range<usize>,
    /// Row by row, and within a row pixel by pixel.
    values: Vec<f32>,
}

impl Features {
    /// The features of `rows`, row by row and pixel by pixel.
    ///
    /// # Panics
    /// If `values` has another length than `rows.len() * width * channels`.
    fn new(width: usize, channels: usize, rows: Range<usize>, values: Vec<f32>) -> Features {
        assert_eq!(values.len(), rows.len() * width * channels, "the features of {rows:?}");
        Features { width, channels, rows, values }
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Values for each pixel.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The rows of the image that have features here.
    pub fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// The features of row `v`, pixel by pixel.
    ///
    /// # Panics
    /// If the row has none here.
    pub fn row(&self, v: usize) -> &[f32] {
        assert!(self.rows.contains(&v), "row {v} of {:?}", self.rows);
        let length = self.width * self.channels;
        &self.values[(v - self.rows.start) * length..][..length]
    }

    /// The features of the pixel in column `u` of row `v`.
    ///
    /// # Panics
    /// If the pixel has none here.
    pub fn pixel(&self, u: usize, v: usize) -> &[f32] {
        &self.row(v)[u * self.channels..][..self.channels]
    }

    /// Moves on to `rows`: drops the features of other rows, and gets those that are missing from `more`.
    pub(super) fn advance(&mut self, rows: Range<usize>, more: impl FnOnce(Range<usize>) -> Features) {
        let kept = if self.rows.contains(&rows.start) { self.rows.end } else { rows.start };
        let length = self.width * self.channels;
        self.values.drain(..self.values.len() - (kept - rows.start) * length);
        self.values.truncate(rows.len() * length);
        if kept < rows.end {
            self.values.extend(more(kept..rows.end).values);
        }
        self.rows = rows;
    }
}

/// A network with its weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    architecture: Architecture,
    convolutions: [FloatLayer; 5],
    comparison: Comparison,
}

/// A comparison of features.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Comparison {
    /// By their cosine. Features have length 1, so it is their dot product.
    Cosine,
    /// By fully connected layers.
    Connected(Box<Connected>),
}

/// The fully connected layers. The input of the first is the features of both pixels, one after the other. So
/// each of its sums has a part for either pixel, and each part is computed once per pixel instead of once per
/// pair.
///
/// The published layers are not symmetric: their best match lies 0.4 pixels to the left of the true one,
/// whichever of the two images it is in. So each pair is compared both ways round, and the similarities are
/// averaged.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Connected {
    /// The part of the first layer for the first pixel of a pair, without a bias.
    first: FloatLayer,
    /// The part of the first layer for the second pixel.
    second: FloatLayer,
    hidden: [FloatLayer; 2],
    weights: Vec<f32>,
    bias: f32,
}

impl Network {
    /// The network with installed weights.
    ///
    /// # Errors
    /// If the weights are not installed, or their file is damaged.
    pub fn load(architecture: Architecture) -> Result<Network> {
        Weights::load(architecture).map(|weights| Network::new(&weights))
    }

    /// The network with these weights.
    pub fn new(weights: &Weights) -> Network {
        let architecture = weights.architecture();
        let convolution = |i: usize| {
            let channels = if i == 0 { 1 } else { architecture.channels() };
            let (values, biases) = weights.layer(&format!("conv_blocks.{}", 2 * i));
            // In the file, a channel's 9 pixels are side by side; in an image, a pixel's channels.
            FloatLayer::new(3, channels, biases, |input, output| {
                let (pixel, channel) = (input / channels, input % channels);
                values[(output * channels + channel) * 9 + pixel]
            })
        };
        let comparison = match architecture {
            Architecture::Fast => Comparison::Cosine,
            Architecture::Accurate => Comparison::Connected(Box::new(Connected::new(weights))),
        };
        Network { architecture, convolutions: array::from_fn(convolution), comparison }
    }

    /// The network's architecture.
    pub fn architecture(&self) -> Architecture {
        self.architecture
    }

    pub(super) fn comparison(&self) -> &Comparison {
        &self.comparison
    }

    /// The features of `rows` of an image, computed on the threads of the current pool. Those of the fast
    /// network have length 1.
    ///
    /// # Panics
    /// If the image does not have these rows.
    pub fn features(&self, input: &Input, rows: Range<usize>) -> Features {
        self.describe(input, rows, self.architecture.channels(), |features, out| out.copy_from_slice(&features))
    }

    /// The operands of comparisons for `rows`. For the fast network these are the features. For the accurate
    /// network these are the sums of the first connected layer, first as the first pixel of a pair, then as
    /// the second.
    pub(super) fn operands(&self, input: &Input, rows: Range<usize>) -> Features {
        match &self.comparison {
            Comparison::Cosine => self.features(input, rows),
            Comparison::Connected(connected) => self.describe(input, rows, 2 * HIDDEN, |features, out| {
                let pixels = features.chunks(Connected::CHANNELS * input.width).zip(out.chunks_mut(2 * HIDDEN * input.width));
                let mut sums = vec![0.0; HIDDEN * input.width];
                for (features, out) in pixels {
                    for (layer, start) in [(&connected.first, 0), (&connected.second, HIDDEN)] {
                        layer.apply(&[features], input.width, Activation::Linear, &mut sums);
                        let both = out.chunks_exact_mut(2 * HIDDEN).zip(sums.chunks_exact(HIDDEN));
                        both.for_each(|(out, sums)| out[start..][..HIDDEN].copy_from_slice(sums));
                    }
                }
            }),
        }
    }

    /// Computes the features of `rows` in bands. `finish` turns the features of a band into `channels` values
    /// for each pixel.
    fn describe(
        &self,
        input: &Input,
        rows: Range<usize>,
        channels: usize,
        finish: impl Fn(Vec<f32>, &mut [f32]) + Sync,
    ) -> Features {
        assert!(rows.end <= input.height, "{rows:?} of {} rows", input.height);
        let band = rows.len().div_ceil(rayon::current_num_threads()).clamp(1, BAND);
        let mut values = vec![0.0; rows.len() * input.width * channels];
        values.par_chunks_mut(band * input.width * channels).enumerate().for_each(|(i, out)| {
            let start = rows.start + i * band;
            let band = start..rows.end.min(start + band);
            finish(self.convolve(input, band), out);
        });
        Features::new(input.width, channels, rows, values)
    }

    /// The features of `rows`, pixel by pixel.
    fn convolve(&self, input: &Input, rows: Range<usize>) -> Vec<f32> {
        let channels = self.architecture.channels();
        let [first, deeper @ ..] = &self.convolutions;
        // Each convolution shrinks the image by a pixel on each side.
        let (mut width, mut height) = (input.width + 2 * BORDER - 2, rows.len() + 2 * BORDER - 2);
        let mut values = vec![0.0; height * width * channels];
        for (y, out) in values.chunks_exact_mut(width * channels).enumerate() {
            let inputs: [_; 3] = array::from_fn(|i| input.row(rows.start + y + i));
            first.apply(&inputs, width, Activation::Relu, out);
        }

        let mut line = vec![0.0; width * channels];
        for (i, layer) in deeper.iter().enumerate() {
            let last = i + 1 == deeper.len() && self.architecture == Architecture::Fast;
            let activation = if last { Activation::Linear } else { Activation::Relu };
            let before = width * channels;
            (width, height) = (width - 2, height - 2);
            let out = &mut line[..width * channels];
            for y in 0..height {
                let inputs: [_; 3] = array::from_fn(|i| &values[(y + i) * before..][..before]);
                layer.apply(&inputs, width, activation, out);
                // The output overwrites input rows that later outputs do not need.
                values[y * out.len()..][..out.len()].copy_from_slice(out);
            }
        }
        values.truncate(height * width * channels);
        if self.architecture == Architecture::Fast {
            values.chunks_exact_mut(channels).for_each(normalize);
        }
        values
    }
}

impl Connected {
    /// The inputs of the first layer from one pixel.
    const CHANNELS: usize = 112;

    fn new(weights: &Weights) -> Connected {
        let half = |first: usize| {
            let (values, biases) = weights.layer("fl_blocks.0");
            let biases = if first == 0 { &[0.0; HIDDEN] } else { biases };
            FloatLayer::new(1, Self::CHANNELS, biases, |input, output| values[output * 2 * Self::CHANNELS + first + input])
        };
        let hidden = |name: &str| {
            let (values, biases) = weights.layer(name);
            FloatLayer::new(1, HIDDEN, biases, |input, output| values[output * HIDDEN + input])
        };
        let (values, bias) = weights.layer("fl_blocks.6");
        Connected {
            first: half(0),
            second: half(Self::CHANNELS),
            hidden: ["fl_blocks.2", "fl_blocks.4"].map(hidden),
            weights: values.to_vec(),
            bias: bias[0],
        }
    }

    /// Calls `take` with the index and similarity, from 0 to 1, of each pair. `pairs` has [`HIDDEN`] outputs
    /// of the first layer for each pair. It is overwritten, as is `spare`, which has the same length.
    pub fn similarities(&self, pairs: &mut [f32], spare: &mut [f32], mut take: impl FnMut(usize, f32)) {
        let count = pairs.len() / HIDDEN;
        let [first, second] = &self.hidden;
        first.apply(&[pairs], count, Activation::Relu, spare);
        second.apply(&[spare], count, Activation::Relu, pairs);
        for (pair, values) in pairs.chunks_exact(HIDDEN).enumerate() {
            let score = dot(values, &self.weights) + self.bias;
            take(pair, 1.0 / (1.0 + (-score).exp()));
        }
    }
}

/// The dot product, by 16 partial sums: their order is the same on every machine.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}

/// Scales a vector to length 1, unless it is 0.
fn normalize(vector: &mut [f32]) {
    let length = dot(vector, vector).sqrt().max(1e-12);
    vector.iter_mut().for_each(|value| *value /= length);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of two pixels with three channels. Each value tells its row and position.
    fn features(rows: Range<usize>) -> Features {
        let values = rows.clone().flat_map(|v| (0..6).map(move |i| (10 * v + i) as f32)).collect();
        Features::new(2, 3, rows, values)
    }

    #[test]
    fn pixels_in_rows() {
        let features = features(4..7);
        assert_eq!(features.row(5), [50.0, 51.0, 52.0, 53.0, 54.0, 55.0]);
        assert_eq!(features.pixel(1, 6), [63.0, 64.0, 65.0]);
        assert_eq!((features.width(), features.channels(), features.rows()), (2, 3, 4..7));
    }

    #[test]
    fn advancing_computes_only_missing_rows() {
        for (from, to, made) in [
            (2..5, 3..8, 5..8),
            (2..5, 2..5, 0..0),
            (2..5, 7..9, 7..9),
            (2..5, 5..6, 5..6),
            (4..6, 1..5, 1..5),
            (0..0, 0..3, 0..3),
            (2..8, 3..5, 0..0),
        ] {
            let mut current = features(from.clone());
            let mut asked = 0..0;
            current.advance(to.clone(), |rows| {
                asked = rows.clone();
                features(rows)
            });
            assert_eq!((current, asked), (features(to), made), "{from:?}");
        }
    }
}
