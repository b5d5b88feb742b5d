//! Errors of depth.

use serde::Serialize;

use crate::{
    alignment::median,
    images::{DisparityMap, FloatImage, Geometry},
};

/// The errors of depth over all pixels that have a depth and whose true depth is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DepthErrors {
    /// The median of the absolute error, in millimetres.
    pub median_mm: f64,
    /// The median of the absolute error, in percent of the true depth.
    pub median_percent: f64,
    /// The root mean square error, in percent of the true depth. A few mismatches dominate it.
    pub rms_percent: f64,
    /// The median of the error, in percent of the true depth: above 0 if depths are too large.
    pub bias_percent: f64,
}

impl DepthErrors {
    /// The errors of `estimate`, given true disparities, of which those that are finite are known. `None` if no pixel has both
    /// depths.
    ///
    /// # Panics
    /// If the two maps differ in size.
    pub fn new(estimate: &DisparityMap, truth: &FloatImage, geometry: &Geometry) -> Option<DepthErrors> {
        assert_eq!([truth.width(), truth.height()], [estimate.width(), estimate.height()], "the size of the ground truth");
        let depths = |(d, truth): (&Option<_>, &f32)| {
            let truth = geometry.depth_mm(f64::from(*truth)).filter(|_| truth.is_finite())?;
            Some([geometry.depth_mm(f32::from((*d)?).into())?, truth])
        };
        let depths: Vec<[f64; 2]> = estimate.pixels().iter().zip(truth.pixels()).filter_map(depths).collect();
        let percent = |[depth, truth]: &[f64; 2]| 100.0 * (depth / truth - 1.0);
        let squares: f64 = depths.iter().map(|pair| percent(pair).powi(2)).sum();
        (!depths.is_empty()).then(|| DepthErrors {
            median_mm: median(depths.iter().map(|[depth, truth]| (depth - truth).abs()).collect()),
            median_percent: median(depths.iter().map(|pair| percent(pair).abs()).collect()),
            rms_percent: (squares / depths.len() as f64).sqrt(),
            bias_percent: median(depths.iter().map(percent).collect()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEOMETRY: Geometry = Geometry { focal_px: 500.0, baseline_mm: 40.0, principal_point: [2.0, 0.0], doffs: 2.0 };

    #[test]
    fn errors_match_a_calculation_by_hand() {
        // The depths are 20 000 / (d + 2): 2000, 2500, 1000 and 2000 mm instead of 2000, 2000, 1250 and 2500. The other pixels
        // have no depth, or no truth.
        let (none, infinity) = (f32::INFINITY, f32::INFINITY);
        let estimate = DisparityMap::from_float(&FloatImage::new(7, 1, vec![8.0, 6.0, 18.0, 8.0, none, -2.0, 8.0]));
        let truth = FloatImage::new(7, 1, vec![8.0, 8.0, 14.0, 6.0, 8.0, 8.0, infinity]);
        let errors = DepthErrors::new(&estimate, &truth, &GEOMETRY).unwrap();
        // 0, 500, 250 and 500 mm; 0, 25, -20 and -20 %. The median of four is the third.
        let expected = [500.0, 20.0, ((625.0 + 400.0 + 400.0) / 4.0f64).sqrt(), 0.0];
        let found = [errors.median_mm, errors.median_percent, errors.rms_percent, errors.bias_percent];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} instead of {expected:?}");
    }

    #[test]
    fn without_a_common_pixel_there_are_no_errors() {
        let estimate = DisparityMap::from_float(&FloatImage::new(3, 1, vec![f32::INFINITY, -3.0, 5.0]));
        let truth = FloatImage::new(3, 1, vec![8.0, 8.0, -2.0]);
        assert_eq!(DepthErrors::new(&estimate, &truth, &GEOMETRY), None);
    }
}
