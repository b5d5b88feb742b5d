//! Error metrics of disparity maps, and the quality of confidences: the errors among the surest pixels.

use multiscopic_core::Disparity;
use serde::{Deserialize, Serialize};

use crate::images::{DisparityMap, FloatImage, Raster};

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

/// The errors by which the 4D light field benchmark compares methods: of disparities between neighbouring cameras, over the
/// pixels that are 15 pixels or more from the border.
///
/// An invalid pixel counts as bad, and enters the mean as a disparity of 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LightFieldMetrics {
    /// The percentage of pixels with an error above 0.07 pixels: the benchmark's BadPix.
    pub bad_pix_0_07: f64,
    /// The percentage of pixels with an error above 0.03 pixels.
    pub bad_pix_0_03: f64,
    /// The percentage of pixels with an error above 0.01 pixels.
    pub bad_pix_0_01: f64,
    /// The mean square error, in hundredths of a square pixel.
    pub mse_x100: f64,
}

impl LightFieldMetrics {
    /// The pixels at the border that do not count.
    const BORDER: usize = 15;

    /// The errors of `estimate`, both it and `truth` at a baseline of so many `steps` from camera to camera. `None` if no
    /// disparity inside the border is known.
    ///
    /// # Panics
    /// If the two maps differ in size.
    pub fn new(estimate: &DisparityMap, truth: &FloatImage, steps: f64) -> Option<LightFieldMetrics> {
        let size @ [width, height] = [estimate.width(), estimate.height()];
        assert_eq!([truth.width(), truth.height()], size, "the size of the ground truth");
        let inner = |side: usize| LightFieldMetrics::BORDER..side.saturating_sub(LightFieldMetrics::BORDER);
        let pixels = inner(height).flat_map(|v| inner(width).map(move |u| (u, v)));
        let known = pixels.map(|(u, v)| (estimate.get(u, v), truth.get(u, v))).filter(|(_, truth)| truth.is_finite());
        let errors: Vec<PixelError> = known.map(|(d, truth)| PixelError::new(d, truth)).collect();
        let mean = |value: &dyn Fn(&PixelError) -> f64| errors.iter().map(value).sum::<f64>() / errors.len() as f64;
        let bad = |limit: f64| 100.0 * mean(&|error| f64::from(!error.valid || error.pixels > limit * steps));
        (!errors.is_empty()).then(|| LightFieldMetrics {
            bad_pix_0_07: bad(0.07),
            bad_pix_0_03: bad(0.03),
            bad_pix_0_01: bad(0.01),
            mse_x100: 100.0 * mean(&|error| (error.pixels / steps).powi(2)),
        })
    }

    /// The mean of each metric, or `None` if `all` is empty.
    pub fn mean(all: &[LightFieldMetrics]) -> Option<LightFieldMetrics> {
        let mean = |value: fn(&LightFieldMetrics) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| LightFieldMetrics {
            bad_pix_0_07: mean(|m| m.bad_pix_0_07),
            bad_pix_0_03: mean(|m| m.bad_pix_0_03),
            bad_pix_0_01: mean(|m| m.bad_pix_0_01),
            mse_x100: mean(|m| m.mse_x100),
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

/// The numbers of pixels with each confidence that are right, with an error of at most one pixel, and that are wrong.
///
/// The pixels are those whose true disparity is known. An invalid one is wrong, and has the confidence 0. The *density* is the
/// share of pixels that is kept, the surest first; of pixels of the same confidence, right and wrong ones are kept in
/// proportion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sparsification {
    /// By confidence: the pixels that are right, and those that are wrong.
    counts: [[u64; 2]; 256],
}

/// The quality of a disparity map's confidences.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConfidenceMetrics {
    /// The area under the sparsification curve: the mean share of wrong pixels at densities of 5, 10, ... 100 %.
    pub auc: f64,
    /// The smallest possible [`auc`](ConfidenceMetrics::auc): every pixel that is wrong is less sure than every one that is
    /// right.
    pub auc_optimal: f64,
    /// The area under the receiver operating characteristic: how probable it is that a pixel that is right is surer than one
    /// that is wrong. 1 if there is none of either.
    pub roc_auc: f64,
    /// The expected calibration error: by how much the confidence, as a probability, differs from the share of pixels that are
    /// right. The mean over ten bins of equal width, weighted by their pixels.
    pub ece: f64,
    /// The percentage of wrong pixels among the surest 90 %.
    pub bad_1_at_90: f64,
    /// The percentage of wrong pixels among the surest 80 %.
    pub bad_1_at_80: f64,
    /// The percentage of wrong pixels among the surest 70 %.
    pub bad_1_at_70: f64,
}

impl Sparsification {
    /// The densities of the curve.
    pub const DENSITIES: [f64; 20] = {
        let mut densities = [0.0; 20];
        let mut k = 0;
        while k < densities.len() {
            densities[k] = 0.05 * (k + 1) as f64;
            k += 1;
        }
        densities
    };

    /// The curve of `estimate` with `confidences`. There is none if no disparity of `truth` is known, which is finite.
    ///
    /// # Panics
    /// If the three differ in size.
    pub fn new(estimate: &DisparityMap, confidences: &Raster<u8>, truth: &FloatImage) -> Option<Sparsification> {
        let size = (estimate.width(), estimate.height());
        assert_eq!([(truth.width(), truth.height()), (confidences.width(), confidences.height())], [size; 2], "sizes");
        let mut counts = [[0; 2]; 256];
        for ((pixel, &confidence), &truth) in estimate.pixels().iter().zip(confidences.pixels()).zip(truth.pixels()) {
            if truth.is_finite() {
                let is_wrong = pixel.is_none_or(|d| (f64::from(f32::from(d)) - f64::from(truth)).abs() > 1.0);
                let confidence = if pixel.is_some() { confidence } else { 0 };
                counts[usize::from(confidence)][usize::from(is_wrong)] += 1;
            }
        }
        Sparsification::of_counts(counts)
    }

    /// The curve of so many right and so many wrong pixels with each confidence. There is none of no pixels.
    pub fn of_counts(counts: [[u64; 2]; 256]) -> Option<Sparsification> {
        counts.iter().flatten().any(|&count| count > 0).then_some(Sparsification { counts })
    }

    /// The number of pixels that are right, and that are wrong.
    fn totals(&self) -> [f64; 2] {
        [0, 1].map(|kind| self.counts.iter().map(|count| count[kind]).sum::<u64>() as f64)
    }

    /// The share of wrong pixels at a density above 0.
    pub fn wrong_at(&self, density: f64) -> f64 {
        let kept = density * self.totals().iter().sum::<f64>();
        let (mut rest, mut wrong) = (kept, 0.0);
        for count in self.counts.iter().rev().filter(|count| **count != [0; 2]) {
            let [right_here, wrong_here] = count.map(|count| count as f64);
            let share = (rest / (right_here + wrong_here)).min(1.0);
            wrong += share * wrong_here;
            rest -= share * (right_here + wrong_here);
        }
        wrong / kept
    }

    /// The share of wrong pixels at a density above 0, if all that are right were surer.
    pub fn least_wrong_at(&self, density: f64) -> f64 {
        let [right, wrong] = self.totals();
        let kept = density * (right + wrong);
        (kept - right).max(0.0) / kept
    }

    /// Returns the metrics of the curve.
    pub fn metrics(&self) -> ConfidenceMetrics {
        let mean = |share: &dyn Fn(f64) -> f64| {
            Self::DENSITIES.iter().map(|&density| share(density)).sum::<f64>() / Self::DENSITIES.len() as f64
        };
        let percent = |density| 100.0 * self.wrong_at(density);
        ConfidenceMetrics {
            auc: mean(&|density| self.wrong_at(density)),
            auc_optimal: mean(&|density| self.least_wrong_at(density)),
            roc_auc: self.roc_auc(),
            ece: self.calibration_error(),
            bad_1_at_90: percent(0.9),
            bad_1_at_80: percent(0.8),
            bad_1_at_70: percent(0.7),
        }
    }

    fn roc_auc(&self) -> f64 {
        let [all_right, all_wrong] = self.totals();
        let (mut less_sure, mut ordered) = (0.0, 0.0);
        for count in &self.counts {
            let [right, wrong] = count.map(|count| count as f64);
            ordered += right * (less_sure + wrong / 2.0);
            less_sure += wrong;
        }
        if all_right * all_wrong > 0.0 { ordered / (all_right * all_wrong) } else { 1.0 }
    }

    fn calibration_error(&self) -> f64 {
        let mut bins = [0.0; 10];
        for (confidence, count) in self.counts.iter().enumerate() {
            let ([right, wrong], probability) = (count.map(|count| count as f64), confidence as f64 / 255.0);
            bins[(10 * confidence / 255).min(9)] += probability * (right + wrong) - right;
        }
        bins.iter().map(|bin: &f64| bin.abs()).sum::<f64>() / self.totals().iter().sum::<f64>()
    }
}

impl ConfidenceMetrics {
    /// The mean of each metric, or `None` if `all` is empty.
    pub fn mean(all: &[ConfidenceMetrics]) -> Option<ConfidenceMetrics> {
        let mean = |value: fn(&ConfidenceMetrics) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| ConfidenceMetrics {
            auc: mean(|m| m.auc),
            auc_optimal: mean(|m| m.auc_optimal),
            roc_auc: mean(|m| m.roc_auc),
            ece: mean(|m| m.ece),
            bad_1_at_90: mean(|m| m.bad_1_at_90),
            bad_1_at_80: mean(|m| m.bad_1_at_80),
            bad_1_at_70: mean(|m| m.bad_1_at_70),
        })
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

    #[test]
    fn light_fields_count_in_camera_steps_without_a_border() {
        // Inside the border, 2 x 1 pixels: errors of a quarter of a pixel in four steps, and an invalid one of 1 pixel.
        let inner = |u: usize, v: usize| (15..17).contains(&u) && v == 15;
        let pixels = || (0..31).flat_map(|v| (0..32).map(move |u| (u, v)));
        let disparity = |(u, v)| Disparity::from_bits(if inner(u, v) { 80 } else { -640 }).filter(|_| u != 16);
        let estimate = DisparityMap::new(32, 31, pixels().map(disparity).collect());
        let truth = FloatImage::filled(32, 31, 1.0);
        let metrics = LightFieldMetrics::new(&estimate, &truth, 4.0);
        let expected =
            LightFieldMetrics { bad_pix_0_07: 50.0, bad_pix_0_03: 100.0, bad_pix_0_01: 100.0, mse_x100: 100.0 * 1.0625 / 32.0 };
        assert_eq!(metrics, Some(expected));
        assert_eq!(LightFieldMetrics::mean(&[expected, LightFieldMetrics::default()]).map(|mean| mean.bad_pix_0_03), Some(50.0));
        assert_eq!(LightFieldMetrics::new(&estimate, &truth.map(|_| f32::NAN), 4.0), None);
    }

    /// Right and wrong pixels with their confidences, and one that is invalid.
    fn curve(right: &[u8], wrong: &[u8]) -> Sparsification {
        let mut counts = [[0; 2]; 256];
        right.iter().for_each(|&confidence| counts[usize::from(confidence)][0] += 1);
        wrong.iter().for_each(|&confidence| counts[usize::from(confidence)][1] += 1);
        Sparsification::of_counts(counts).unwrap()
    }

    #[test]
    fn a_map_is_counted_where_the_truth_is_known() {
        let disparity = |pixels: f32| Disparity::from_bits((pixels * 64.0) as i16);
        let estimate = DisparityMap::new(5, 1, vec![disparity(3.0), disparity(4.0), disparity(4.5), None, disparity(1.0)]);
        let truth = FloatImage::new(5, 1, vec![3.0, 3.0, 3.0, 0.0, f32::INFINITY]);
        let confidences = Raster::new(5, 1, vec![200, 100, 100, 250, 7]);
        assert_eq!(Sparsification::new(&estimate, &confidences, &truth), Some(curve(&[200, 100], &[100, 0])));
        assert_eq!(Sparsification::new(&estimate, &confidences, &truth.map(|_| f32::NAN)), None);
    }

    #[test]
    fn the_curve_matches_a_calculation_by_hand() {
        // From the surest on: right, right or wrong, right or wrong, wrong.
        let curve = curve(&[200, 100], &[100, 0]);
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        for (density, expected, least) in [(0.25, 0.0, 0.0), (0.5, 0.25, 0.0), (0.75, 1.0 / 3.0, 1.0 / 3.0), (1.0, 0.5, 0.5)] {
            near(curve.wrong_at(density), expected);
            near(curve.least_wrong_at(density), least);
        }
        let metrics = curve.metrics();
        // Of the four pairs of a right and a wrong one, three are in order, and one is equally sure.
        near(metrics.roc_auc, 3.5 / 4.0);
        // Bins of one right at 0.784, of one of each at 0.392, and of one wrong at 0.
        near(metrics.ece, (0.25 * (1.0 - 200.0 / 255.0)) + 0.5 * (0.5 - 100.0 / 255.0));
        near(metrics.bad_1_at_90, 100.0 * (1.0 + 0.6) / 3.6);
        let by_hand = |wrong: &dyn Fn(f64) -> f64| (1..=20).map(|k| wrong(f64::from(k) / 20.0)).sum::<f64>() / 20.0;
        near(metrics.auc, by_hand(&|density| curve.wrong_at(density)));
        near(metrics.auc_optimal, by_hand(&|density| (1.0 - 0.5 / density).max(0.0)));
    }

    #[test]
    fn certainty_is_perfect_where_nothing_is_wrong() {
        let metrics = curve(&[255, 255], &[]).metrics();
        assert_eq!((metrics.auc, metrics.auc_optimal, metrics.roc_auc, metrics.ece), (0.0, 0.0, 1.0, 0.0));
        assert!(Sparsification::of_counts([[0; 2]; 256]).is_none());
        assert_eq!(ConfidenceMetrics::mean(&[]), None);
    }
}
