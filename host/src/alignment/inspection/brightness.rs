//! The brightness of a view beside that of the centre: a gain, which may change over the image, and an offset.
//!
//! ```text
//! for each corner found in the view: the mean around it in the centre, and around its match in the view
//! view = (gain + right x + down y) center + offset, by least squares in which outliers weigh less and less
//! ```

use std::ops::RangeInclusive;

use image::{ImageBuffer, Pixel};
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use crate::{images::Picture, statistics::median};

/// The noise of a mean, in grey values.
const NOISE: f64 = 3.0;
/// The usual change of the gain from the middle of an image to its border.
const USUAL_SLOPE: f64 = 0.1;
/// The usual offset, in grey values.
const USUAL_OFFSET: f64 = 8.0;
/// The steps of the robust fit.
const STEPS: usize = 10;
/// The least number of corners.
const MIN_SAMPLES: usize = 30;
/// The effect that is left alone, as a root mean square, in grey values.
const NEGLIGIBLE: f64 = 2.0;
/// The share of the samples' differences from the centre that a change of brightness may leave unexplained.
const UNEXPLAINED: f64 = 0.6;
/// The most and the least gain anywhere that is evened out.
const GAINS: RangeInclusive<f64> = 0.2..=5.0;
/// The change of the gain from border to border, as a share of it, from which on the light is called uneven.
const UNEVEN: f64 = 0.15;

/// The means around a corner in the centre and around its match in a view, in grey values.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// The place in the view, from -1 to 1 on both axes.
    pub at: [f64; 2],
    pub center: f64,
    pub view: f64,
}

/// The brightness of a view, given that of the centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brightness {
    /// In the middle of the image, and what is added up to its right and its lower border.
    gain: [f64; 3],
    /// In grey values.
    offset: f64,
    /// The median of the samples' relative change.
    change: f64,
}

impl Brightness {
    /// The brightness that explains the samples, unless it is that of the centre.
    pub fn fit(samples: &[Sample]) -> Option<Brightness> {
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        let row = |sample: &Sample| {
            let [x, y] = sample.at;
            Vector4::new(sample.center, sample.center * x, sample.center * y, 1.0)
        };
        let prior =
            Vector4::new(0.0, (NOISE / USUAL_SLOPE).powi(2), (NOISE / USUAL_SLOPE).powi(2), (NOISE / USUAL_OFFSET).powi(2));
        let mut model = Vector4::new(median(samples.iter().map(|s| s.view / s.center.max(1.0)).collect()), 0.0, 0.0, 0.0);
        for _ in 0..STEPS {
            let (mut matrix, mut right) = (Matrix4::from_diagonal(&prior), Vector4::zeros());
            for sample in samples {
                let row = row(sample);
                let residual = (sample.view - row.dot(&model)) / (2.0 * NOISE);
                let weight = 1.0 / (1.0 + residual * residual).powi(2);
                matrix += weight * row * row.transpose();
                right += weight * row * sample.view;
            }
            model = matrix.cholesky()?.solve(&right);
        }
        let effect = samples.iter().map(|sample| (row(sample).dot(&model) - sample.center).powi(2)).sum::<f64>();
        let [gain, right, down, offset] = model.into();
        let steepest = right.abs() + down.abs();
        let is_possible = GAINS.contains(&(gain - steepest)) && GAINS.contains(&(gain + steepest));
        let change = median(samples.iter().map(|s| s.view / s.center.max(1.0)).collect()) - 1.0;
        let difference = |from: &dyn Fn(&Sample) -> f64| median(samples.iter().map(|s| (s.view - from(s)).abs()).collect());
        let is_explained = difference(&|s| row(s).dot(&model)) < UNEXPLAINED * difference(&|s| s.center);
        let is_clear = is_explained && (effect / samples.len() as f64).sqrt() > NEGLIGIBLE;
        (is_possible && is_clear).then_some(Brightness { gain: [gain, right, down], offset, change })
    }

    /// The share by which the view is brighter than the centre; negative if it is darker.
    pub fn change(&self) -> f64 {
        self.change
    }

    /// True if the gain changes much over the image.
    pub fn is_uneven(&self) -> bool {
        let [gain, right, down] = self.gain;
        2.0 * right.abs().max(down.abs()) > UNEVEN * gain
    }

    /// The picture of the view, as bright as the centre, in 8 bits.
    pub fn evened(&self, picture: Picture) -> Picture {
        let mut picture = picture.into_8_bits();
        match &mut picture {
            Picture::Gray(image) => self.even(image),
            Picture::Rgb(image) => self.even(image),
            Picture::Gray16(_) | Picture::Rgb16(_) => {}
        }
        picture
    }

    fn even<P: Pixel<Subpixel = u8>>(&self, image: &mut ImageBuffer<P, Vec<u8>>) {
        let [gain, right, down] = self.gain;
        let (width, height) = image.dimensions();
        let channels = usize::from(P::CHANNEL_COUNT);
        image.par_chunks_exact_mut(width as usize * channels).enumerate().for_each(|(v, row)| {
            let in_row = gain + down * from_middle(v as f64, height);
            for (u, pixel) in row.chunks_exact_mut(channels).enumerate() {
                let scale = 1.0 / (in_row + right * from_middle(u as f64, width));
                // The conversion clamps.
                pixel.iter_mut().for_each(|sample| *sample = ((f64::from(*sample) - self.offset) * scale).round() as u8);
            }
        });
    }
}

/// A coordinate from -1 at the first of so many pixels to 1 at the last.
pub fn from_middle(at: f64, side: u32) -> f64 {
    2.0 * at / f64::from(side.max(2) - 1) - 1.0
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    /// Samples of a view that is `gain`, and `right` more at its right border, times as bright, plus `offset`; a tenth of them
    /// are wrong.
    fn samples(gain: f64, right: f64, offset: f64) -> Vec<Sample> {
        let mut random = fastrand::Rng::with_seed(3);
        let mut sample = |n: usize| {
            let (x, y, center) = (2.0 * random.f64() - 1.0, 2.0 * random.f64() - 1.0, 40.0 + 160.0 * random.f64());
            let wrong = if n.is_multiple_of(10) { 60.0 } else { 0.0 };
            Sample { at: [x, y], center, view: (gain + right * x) * center + offset + 2.0 * random.f64() - 1.0 + wrong }
        };
        (0..200).map(&mut sample).collect()
    }

    #[test]
    fn a_darker_view_that_is_lit_from_one_side_becomes_as_bright_as_the_centre() {
        assert_eq!(Brightness::fit(&samples(1.0, 0.0, 0.0)), None);
        assert_eq!(Brightness::fit(&samples(0.6, 0.1, 5.0)[..20]), None, "too few corners");
        let brightness = Brightness::fit(&samples(0.6, 0.1, 5.0)).expect("it is darker");
        assert!(brightness.is_uneven() && (-0.4..-0.3).contains(&brightness.change()), "{brightness:?}");
        let center = GrayImage::from_fn(64, 8, |u, v| image::Luma([(60 + u + 8 * v) as u8]));
        let view = GrayImage::from_fn(64, 8, |u, v| {
            let center = f64::from(center.get_pixel(u, v).0[0]);
            image::Luma([((0.6 + 0.1 * from_middle(u.into(), 64)) * center + 5.0).round() as u8])
        });
        let Picture::Gray(evened) = brightness.evened(Picture::Gray(view)) else { panic!("it was grey") };
        let worst = evened.as_raw().iter().zip(center.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(4), "{worst:?} grey values off");
    }
}
