//! Error metrics of disparity maps.

use multiscopic_core::Disparity;
use serde::{Deserialize, Serialize};

use crate::images::{DisparityMap, FloatImage};

/// The errors of a disparity map over all pixels whose true disparity is known.
///
/// An invalid pixel counts as bad, and enters the mean errors as a disparity of 0.
///
/// ```
/// use multiscopic::{DisparityMap, FloatImage, Metrics};
/// let truth = FloatImage::new(4, 1, vec![10.0, 10.0, 10.0, f32::INFINITY]);
/// let estimate = DisparityMap::from_float(&FloatImage::new(4, 1, vec![10.0, 13.0, 10.0, 2.0]));
/// let metrics = Metrics::new(&estimate, &truth).expect("a known disparity");
/// assert_eq!((metrics.avg_err, metrics.coverage), (1.0, 1.0));
/// assert_eq!(metrics.bad_1.round(), 33.0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Root mean square error, in pixels.
    pub rms: f64,
    /// Mean absolute error, in pixels.
    pub avg_err: f64,
    /// The percentage of pixels with an error above 0.5 pixels.
    pub bad_0_5: f64,
    /// The percentage of pixels with an error above 1 pixel.
    pub bad_1: f64,
    /// The percentage of pixels with an error above 2 pixels.
    pub bad_2: f64,
    /// The share of valid pixels, from 0 to 1.
    pub coverage: f64,
}

impl Metrics {
    /// The errors of `estimate`. A disparity of `truth` is known if it is finite; if none is, there are no
    /// metrics.
    ///
    /// # Panics
    /// If the two maps differ in size.
    pub fn new(estimate: &DisparityMap, truth: &FloatImage) -> Option<Metrics> {
        let size = (estimate.width(), estimate.height());
        assert_eq!((truth.width(), truth.height()), size, "the size of the ground truth");
        let pairs = estimate.pixels().iter().zip(truth.pixels());
        let errors = || pairs.clone().filter(|(_, truth)| truth.is_finite()).map(|(&d, &truth)| PixelError::new(d, truth));
        let count = errors().count();
        if count == 0 {
            return None;
        }
        let mean = |value: &dyn Fn(PixelError) -> f64| errors().map(value).sum::<f64>() / count as f64;
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

    /// The mean of each metric, or `None` if `all` is empty.
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

/// The error of one pixel.
#[derive(Clone, Copy)]
struct PixelError {
    valid: bool,
    pixels: f64,
}

impl PixelError {
    fn new(d: Option<Disparity>, truth: f32) -> PixelError {
        let estimate = d.map_or(0.0, f32::from);
        PixelError { valid: d.is_some(), pixels: (f64::from(estimate) - f64::from(truth)).abs() }
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
    fn metrics_match_a_calculation_by_hand() {
        // The errors are 0, 0.5, 1, 2.5 and, for the invalid pixel, 4. The last two pixels have no truth.
        let estimate = map(&[Some(3.0), Some(3.5), Some(2.0), Some(-2.5), None, Some(9.0), None]);
        let truth = truth(&[3.0, 3.0, 3.0, -5.0, 4.0, f32::INFINITY, f32::NAN]);
        let metrics = Metrics::new(&estimate, &truth).unwrap();
        assert_eq!(metrics.rms, (23.5f64 / 5.0).sqrt());
        assert_eq!(metrics.avg_err, 1.6);
        // An error equal to the threshold is not bad.
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
    fn without_truth_there_are_no_metrics() {
        assert_eq!(Metrics::new(&map(&[Some(1.0)]), &truth(&[f32::INFINITY])), None);
        assert_eq!(Metrics::mean(&[]), None);
    }

    #[test]
    fn the_mean_is_taken_of_each_metric() {
        let scene = |x: f64| Metrics { rms: x, avg_err: 2.0 * x, bad_0_5: 3.0 * x, bad_1: 4.0 * x, bad_2: 5.0 * x, coverage: x };
        assert_eq!(Metrics::mean(&[scene(0.25), scene(0.75)]), Some(scene(0.5)));
    }
}
