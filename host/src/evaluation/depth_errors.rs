//! Errors of depth, and noise over repeated captures.

use serde::Serialize;

use crate::{
    images::{DisparityMap, FloatImage, Geometry, ImageRegion},
    statistics::median,
};

/// The differences of disparities between captures of the same scene: the median over the pixels of the standard deviation over
/// the captures.
///
/// A median of standard deviations of few numbers is too small. It is corrected, as for normally distributed errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TemporalNoise {
    /// The number of captures.
    pub captures: usize,
    /// The share of the pixels that are valid in all captures, in percent. Only they count.
    pub valid: f64,
    /// The noise of disparities, in pixels.
    pub px: f64,
    /// The noise of depth, in millimetres, if the geometry is known.
    pub mm: Option<f64>,
    /// The noise of depth, in percent of each pixel's depth, if the geometry is known.
    pub percent: Option<f64>,
}

impl TemporalNoise {
    /// The noise in a region. `None` if there are fewer than two captures, or no pixel is valid in all.
    ///
    /// # Panics
    /// If the maps differ in size, or the region leaves them.
    pub fn new(captures: &[DisparityMap], geometry: Option<&Geometry>, region: ImageRegion) -> Option<TemporalNoise> {
        let all = |[u, v]: [usize; 2]| {
            let disparity = |map: &DisparityMap| map.get(u, v).map(|d| f64::from(f32::from(d)));
            captures.iter().map(disparity).collect::<Option<Vec<f64>>>()
        };
        let pixels: Vec<Vec<f64>> = region.pixels().filter_map(all).collect();
        if captures.len() < 2 || pixels.is_empty() {
            return None;
        }
        let depths: Option<Vec<Vec<f64>>> = geometry.map(|geometry| {
            let depth = |pixel: &Vec<f64>| pixel.iter().map(|d| geometry.depth_mm(*d)).collect();
            pixels.iter().filter_map(depth).collect()
        });
        let depths = depths.filter(|depths| !depths.is_empty());
        let correction = correction(captures.len());
        let noise = |of: &dyn Fn(&Vec<f64>) -> f64, pixels: &[Vec<f64>]| median(pixels.iter().map(of).collect()) / correction;
        Some(TemporalNoise {
            captures: captures.len(),
            valid: 100.0 * pixels.len() as f64 / region.area() as f64,
            px: noise(&|pixel| deviation(pixel), &pixels),
            mm: depths.as_ref().map(|depths| noise(&|pixel| deviation(pixel), depths)),
            percent: depths.as_ref().map(|depths| noise(&|pixel| 100.0 * deviation(pixel) / mean(pixel), depths)),
        })
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The standard deviation of a sample.
fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}

/// The median standard deviation of samples of `count` normally distributed numbers, in standard deviations: the root of the
/// median of a chi-squared distribution by its degrees of freedom, by the approximation of Wilson and Hilferty (1931).
fn correction(count: usize) -> f64 {
    let freedom = (count - 1) as f64;
    (1.0 - 2.0 / (9.0 * freedom)).powf(1.5)
}

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
    use crate::images::FloatImage;

    const SIZE: [usize; 2] = [80, 60];
    const GEOMETRY: Geometry = Geometry { focal_px: 400.0, baseline_mm: 20.0, principal_point: [0.0; 2], doffs: 0.0 };

    /// Captures of a wall with a disparity of 20 pixels and normally distributed noise.
    fn captures(count: usize, deviation: f64) -> Vec<DisparityMap> {
        let mut random = fastrand::Rng::with_seed(2);
        let mut disparity = || {
            // Box and Muller.
            let (radius, angle) = ((-2.0 * (1.0 - random.f64()).ln()).sqrt(), std::f64::consts::TAU * random.f64());
            (20.0 + deviation * radius * angle.cos()) as f32
        };
        let pixels = SIZE[0] * SIZE[1];
        let mut capture = || FloatImage::new(SIZE[0], SIZE[1], (0..pixels).map(|_| disparity()).collect());
        (0..count).map(|_| DisparityMap::from_float(&capture())).collect()
    }

    #[test]
    fn noise_is_that_of_the_captures_whatever_their_number() {
        for count in [2, 3, 5, 10] {
            let noise = TemporalNoise::new(&captures(count, 0.25), Some(&GEOMETRY), ImageRegion::whole(SIZE)).unwrap();
            assert_eq!((noise.captures, noise.valid), (count, 100.0));
            // At 400 mm, a pixel is Z^2 / (f B) = 20 mm.
            for (found, expected) in [(noise.px, 0.25), (noise.mm.unwrap(), 5.0), (noise.percent.unwrap(), 1.25)] {
                assert!((found / expected - 1.0).abs() < 0.04, "{count}: {found} instead of {expected}");
            }
        }
    }

    #[test]
    fn pixels_count_if_they_are_valid_in_all_captures() {
        let [mut first, mut second] = <[DisparityMap; 2]>::try_from(captures(2, 0.0)).unwrap();
        first.pixels_mut()[0] = None;
        second.pixels_mut()[2..5].fill(None);
        let region = ImageRegion { left: 0, top: 0, width: 8, height: 1 };
        let noise = TemporalNoise::new(&[first.clone(), second], None, region).unwrap();
        assert_eq!(noise, TemporalNoise { captures: 2, valid: 50.0, px: 0.0, mm: None, percent: None });
        assert_eq!(TemporalNoise::new(&[first.clone()], None, region), None);
        let none = first.map(|_| None);
        assert_eq!(TemporalNoise::new(&[first, none], None, region), None);
    }

    const DEPTH_GEOMETRY: Geometry = Geometry { focal_px: 500.0, baseline_mm: 40.0, principal_point: [2.0, 0.0], doffs: 2.0 };

    #[test]
    fn errors_match_a_calculation_by_hand() {
        // The depths are 20 000 / (d + 2): 2000, 2500, 1000 and 2000 mm instead of 2000, 2000, 1250 and 2500. The other pixels
        // have no depth, or no truth.
        let (none, infinity) = (f32::INFINITY, f32::INFINITY);
        let estimate = DisparityMap::from_float(&FloatImage::new(7, 1, vec![8.0, 6.0, 18.0, 8.0, none, -2.0, 8.0]));
        let truth = FloatImage::new(7, 1, vec![8.0, 8.0, 14.0, 6.0, 8.0, 8.0, infinity]);
        let errors = DepthErrors::new(&estimate, &truth, &DEPTH_GEOMETRY).unwrap();
        // 0, 500, 250 and 500 mm; 0, 25, -20 and -20 %. The median of four is the third.
        let expected = [500.0, 20.0, ((625.0 + 400.0 + 400.0) / 4.0f64).sqrt(), 0.0];
        let found = [errors.median_mm, errors.median_percent, errors.rms_percent, errors.bias_percent];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} instead of {expected:?}");
    }

    #[test]
    fn without_a_common_pixel_there_are_no_errors() {
        let estimate = DisparityMap::from_float(&FloatImage::new(3, 1, vec![f32::INFINITY, -3.0, 5.0]));
        let truth = FloatImage::new(3, 1, vec![8.0, 8.0, -2.0]);
        assert_eq!(DepthErrors::new(&estimate, &truth, &DEPTH_GEOMETRY), None);
    }
}
