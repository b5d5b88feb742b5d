//! How far an estimate is from the truth.

use multiscopic_core::Disparity;
use serde::Serialize;

use crate::images::{DisparityMap, FloatImage};

/// The errors of disparities over all pixels whose true disparity is known.
///
/// An invalid estimate counts as bad, and enters the mean errors as a disparity of 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Metrics {
    /// Root of the mean squared error, in pixels.
    pub rms: f64,
    /// Mean absolute error, in pixels.
    pub avg_err: f64,
    /// Pixels that are off by more than half a pixel, in percent.
    pub bad_0_5: f64,
    /// Pixels that are off by more than one pixel, in percent.
    pub bad_1: f64,
    /// Pixels that are off by more than two pixels, in percent.
    pub bad_2: f64,
    /// The share of valid estimates, from 0 to 1.
    pub coverage: f64,
}

impl Metrics {
    /// The errors of `estimate`. The disparities of `truth` are known where they are finite; `None` if none is.
    ///
    /// # Panics
    /// If they differ in size.
    pub fn new(estimate: &DisparityMap, truth: &FloatImage) -> Option<Metrics> {
        let size = (estimate.width(), estimate.height());
        assert_eq!((truth.width(), truth.height()), size, "the size of the ground truth");
        let pairs = estimate.pixels().iter().zip(truth.pixels());
        let errors = || pairs.clone().filter(|(_, truth)| truth.is_finite()).map(|(&d, &truth)| Error::new(d, truth));
        let count = errors().count();
        if count == 0 {
            return None;
        }
        let mean = |value: &dyn Fn(Error) -> f64| errors().map(value).sum::<f64>() / count as f64;
        let bad = |limit: f64| 100.0 * mean(&|error| f64::from(!error.valid || error.pixels > limit));
        Some(Metrics {
            rms: mean(&|error| error.pixels * error.pixels).sqrt(),
            avg_err: mean(&|error| error.pixels),
            bad_0_5: bad(0.5),
            bad_1: bad(1.0),
            bad_2: bad(2.0),
            coverage: mean(&|error| f64::from(error.valid)),
        })
    }

    /// The mean of each metric; `None` of none.
    pub fn mean(all: &[Metrics]) -> Option<Metrics> {
        let mean = |value: fn(&Metrics) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Metrics {
            rms: mean(|m| m.rms),
            avg_err: mean(|m| m.avg_err),
            bad_0_5: mean(|m| m.bad_0_5),
            bad_1: mean(|m| m.bad_1),
            bad_2: mean(|m| m.bad_2),
            coverage: mean(|m| m.coverage),
        })
    }
}

/// How far the estimate of a pixel is off.
#[derive(Clone, Copy)]
struct Error {
    valid: bool,
    pixels: f64,
}

impl Error {
    fn new(d: Option<Disparity>, truth: f32) -> Error {
        let estimate = d.map_or(0.0, f32::from);
        Error { valid: d.is_some(), pixels: (f64::from(estimate) - f64::from(truth)).abs() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(pixels: &[Option<f32>]) -> DisparityMap {
        let disparity = |pixels: &f32| Disparity::from_bits((pixels * 64.0) as i16).unwrap();
        DisparityMap::new(pixels.len(), 1, pixels.iter().map(|d| d.as_ref().map(disparity)).collect())
    }

    fn truth(pixels: &[f32]) -> FloatImage {
        FloatImage::new(pixels.len(), 1, pixels.to_vec())
    }

    #[test]
    fn by_hand() {
        // Off by 0, 0.5, 1, 2.5 and, where invalid, 4; the last two have no truth.
        let estimate = map(&[Some(3.0), Some(3.5), Some(2.0), Some(-2.5), None, Some(9.0), None]);
        let truth = truth(&[3.0, 3.0, 3.0, -5.0, 4.0, f32::INFINITY, f32::NAN]);
        let metrics = Metrics::new(&estimate, &truth).unwrap();
        assert_eq!(metrics.rms, (23.5f64 / 5.0).sqrt());
        assert_eq!(metrics.avg_err, 1.6);
        // Bad is what is off by more than the limit.
        assert_eq!((metrics.bad_0_5, metrics.bad_1, metrics.bad_2), (60.0, 40.0, 40.0));
        assert_eq!(metrics.coverage, 0.8);
    }

    #[test]
    fn an_invalid_pixel_is_bad_even_where_the_truth_is_0() {
        let metrics = Metrics::new(&map(&[None, Some(0.25)]), &truth(&[0.0, 0.0])).unwrap();
        let expected =
            Metrics { rms: (0.0625f64 / 2.0).sqrt(), avg_err: 0.125, bad_0_5: 50.0, bad_1: 50.0, bad_2: 50.0, coverage: 0.5 };
        assert_eq!(metrics, expected);
    }

    #[test]
    fn without_truth_there_is_no_error() {
        assert_eq!(Metrics::new(&map(&[Some(1.0)]), &truth(&[f32::INFINITY])), None);
        assert_eq!(Metrics::mean(&[]), None);
    }

    #[test]
    fn mean_of_scenes() {
        let scene = |x: f64| Metrics { rms: x, avg_err: 2.0 * x, bad_0_5: 3.0 * x, bad_1: 4.0 * x, bad_2: 5.0 * x, coverage: x };
        assert_eq!(Metrics::mean(&[scene(0.25), scene(0.75)]), Some(scene(0.5)));
    }
}
