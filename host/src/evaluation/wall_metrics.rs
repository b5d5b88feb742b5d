//! The flatness and the distance of a flat wall as a rig sees it.

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use crate::{
    error::{PlaneError, Result},
    images::{DisparityMap, Geometry, ImageRegion},
    statistics::median,
};

/// The error in pixels above which a pixel is an outlier.
const OUTLIER: f64 = 1.0;
/// One pixel in so many is left out of the root mean squares at either end.
const LEFT_OUT: usize = 200;

/// The errors of the disparities of a flat wall, against the plane that fits them best.
///
/// They are those of Intel's "RealSense Camera Depth Testing Methodology" (2018) and of librealsense's Depth Quality Tool,
/// except that the plane is fitted to disparities, and robustly, and that the 0.5 % of the pixels that are left out at both
/// ends are those farthest from the plane, not the nearest and farthest of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WallMetrics {
    /// The share of valid pixels in the region, in percent.
    pub fill_rate: f64,
    /// The root mean square difference from the plane's disparities, in pixels, without the 0.5 % of the pixels that are most
    /// above it and most below it.
    pub rms_px: f64,
    /// The share of the valid pixels that are more than 1 pixel from the plane, in percent.
    pub outliers: f64,
    /// Distances in the scene, if the geometry is known.
    #[serde(flatten)]
    pub place: Option<WallPlace>,
}

/// The place of a wall, and the distances of points from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WallPlace {
    /// The distance along the optical axis, in millimetres.
    pub distance_mm: f64,
    /// The root mean square distance of points from the plane, in millimetres, without the same pixels.
    pub rms_mm: f64,
    /// The same in percent of the distance along the optical axis.
    pub rms_percent: f64,
    /// The angle between the optical axis and the wall's normal, in degrees.
    pub tilt_deg: f64,
    /// By how much the wall recedes to the right, in degrees.
    pub recedes_right_deg: f64,
    /// By how much the wall recedes downwards, in degrees.
    pub recedes_down_deg: f64,
    /// The median error of the distance in percent of the true one, after the plane was turned to be square to the optical
    /// axis: above 0 if the wall seems too far. `None` if the distance is not known.
    pub z_accuracy_percent: Option<f64>,
}

impl WallMetrics {
    /// The errors in a region, and the plane. `distance_mm` is the true distance along the optical axis, if it is known, which
    /// matters only with the geometry. With it, a pixel without a finite depth is not valid.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if the region leaves the map, and [`Error::Plane`](crate::Error::Plane) if it
    /// determines no plane before the camera.
    pub fn new(
        disparities: &DisparityMap,
        geometry: Option<&Geometry>,
        region: ImageRegion,
        distance_mm: Option<f64>,
    ) -> Result<(WallMetrics, PlaneFit)> {
        region.check([disparities.width(), disparities.height()])?;
        let pixel = |[u, v]: [usize; 2]| {
            let d = f64::from(f32::from(disparities.get(u, v)?));
            let has_depth = geometry.is_none_or(|geometry| geometry.depth_mm(d).is_some());
            has_depth.then_some([u as f64, v as f64, d])
        };
        let pixels: Vec<[f64; 3]> = region.pixels().filter_map(pixel).collect();
        let plane = PlaneFit::new(&pixels)?;
        let percent = |count: usize, of: usize| 100.0 * count as f64 / of as f64;
        let mut residuals: Vec<(f64, [f64; 3])> = pixels.iter().map(|pixel| (plane.residual(pixel), *pixel)).collect();
        residuals.sort_unstable_by(|(a, _), (b, _)| a.total_cmp(b));
        let left_out = residuals.len() / LEFT_OUT;
        let kept = &residuals[left_out..residuals.len() - left_out];
        let outliers = residuals.iter().filter(|(residual, _)| residual.abs() > OUTLIER).count();
        let place = geometry.map(|geometry| WallPlace::new(&plane, geometry, kept, distance_mm)).transpose()?;
        let metrics = WallMetrics {
            fill_rate: percent(pixels.len(), region.area()),
            rms_px: root_mean_square(kept.iter().map(|(residual, _)| *residual)),
            outliers: percent(outliers, residuals.len()),
            place,
        };
        Ok((metrics, plane))
    }
}

impl WallPlace {
    /// Of pixels with their residuals.
    fn new(plane: &PlaneFit, geometry: &Geometry, kept: &[(f64, [f64; 3])], true_mm: Option<f64>) -> Result<WallPlace> {
        // A point (X, Y, Z) shows at x = X / Z and y = Y / Z with the disparity s = f B / Z - doffs. So if a plane has a
        // disparity of a + b x + c y - doffs, its points have b X + c Y + a Z = f B.
        let Geometry { focal_px, baseline_mm, principal_point, doffs } = *geometry;
        let ahead = plane.disparity(principal_point) + doffs;
        let [right, down] = plane.slope().map(|slope| slope * focal_px);
        if ahead <= 0.0 {
            return Err(PlaneError::Behind.into());
        }
        let (power, norm) = (focal_px * baseline_mm, (ahead * ahead + right * right + down * down).sqrt());
        let distance_mm = power / ahead;
        let beyond = |(residual, [_, _, d]): &(f64, [f64; 3])| {
            let found = d + doffs;
            // (b X + c Y + a Z - f B) / norm, in which Z = f B / found.
            power * ((found - residual) / found - 1.0) / norm
        };
        let rms_mm = root_mean_square(kept.iter().map(beyond));
        let error = |true_mm: f64| 100.0 * (median(kept.iter().map(beyond).collect()) + distance_mm - true_mm) / true_mm;
        Ok(WallPlace {
            distance_mm,
            rms_mm,
            rms_percent: 100.0 * rms_mm / distance_mm,
            tilt_deg: right.hypot(down).atan2(ahead).to_degrees(),
            recedes_right_deg: (-right).atan2(ahead).to_degrees(),
            recedes_down_deg: (-down).atan2(ahead).to_degrees(),
            z_accuracy_percent: true_mm.map(error),
        })
    }
}

fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// The fewest pixels that a plane is fitted to.
const FEWEST: usize = 100;
/// The number of random samples.
const SAMPLES: usize = 300;
/// The most pixels that judge a sample.
const JUDGES: usize = 2000;
/// The most steps of the refinement.
const STEPS: usize = 20;
/// The ratio of the standard deviation and the median absolute value of normally distributed numbers.
const DEVIATION: f64 = 1.4826;
/// Pixels within this many standard deviations of the plane determine it.
const NEAR: f64 = 3.0;
/// The least standard deviation in pixels that is believed: a step of a disparity.
const LEAST_DEVIATION: f64 = 1.0 / 64.0;

/// A plane in the scene. Its disparities, in pixels, are linear in the coordinates of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFit {
    /// The pixel from which the coordinates count.
    origin: [f64; 2],
    /// The disparity there, and how much it grows with each pixel to the right and down.
    coefficients: Vector3<f64>,
}

impl PlaneFit {
    /// Fits a plane to disparities at pixels, `[u, v, d]`, of which fewer than half may be wrong by any amount: the least
    /// median of squares over random samples (Rousseeuw, 1984), then least squares over the pixels near the plane. Disparities,
    /// unlike depths, have the same noise everywhere.
    ///
    /// # Errors
    /// [`Error::Plane`](crate::Error::Plane) if there are fewer than 100 pixels, or all are on a line.
    pub fn new(pixels: &[[f64; 3]]) -> Result<PlaneFit> {
        if pixels.len() < FEWEST {
            return Err(PlaneError::TooFew { count: pixels.len(), needed: FEWEST }.into());
        }
        let origin = [0, 1].map(|axis| pixels.iter().map(|pixel| pixel[axis]).sum::<f64>() / pixels.len() as f64);
        let plane = |coefficients| PlaneFit { origin, coefficients };
        let fit = |pixels: &mut dyn Iterator<Item = &[f64; 3]>| least_squares(origin, pixels).map(plane);
        let deviation = |plane: &PlaneFit, pixels: &mut dyn Iterator<Item = &[f64; 3]>| {
            DEVIATION * median(pixels.map(|pixel| plane.residual(pixel).abs()).collect())
        };

        let mut random = fastrand::Rng::with_seed(1);
        let stride = pixels.len().div_ceil(JUDGES);
        let mut best: Option<(f64, PlaneFit)> = None;
        for _ in 0..SAMPLES {
            let sample: [&[f64; 3]; 3] = std::array::from_fn(|_| &pixels[random.usize(..pixels.len())]);
            if let Some(plane) = fit(&mut sample.into_iter()) {
                let spread = deviation(&plane, &mut pixels.iter().step_by(stride));
                best = best.filter(|(least, _)| *least <= spread).or(Some((spread, plane)));
            }
        }
        let (_, mut plane) = best.ok_or(PlaneError::OnALine)?;
        for _ in 0..STEPS {
            let limit = NEAR * deviation(&plane, &mut pixels.iter()).max(LEAST_DEVIATION);
            let next = fit(&mut pixels.iter().filter(|pixel| plane.residual(pixel).abs() <= limit)).ok_or(PlaneError::OnALine)?;
            if std::mem::replace(&mut plane, next) == next {
                break;
            }
        }
        Ok(plane)
    }

    /// Its disparity at an image point, in pixels.
    pub fn disparity(&self, [u, v]: [f64; 2]) -> f64 {
        self.coefficients.dot(&row(self.origin, u, v))
    }

    /// Returns the growth of its disparity with each pixel to the right and down.
    pub fn slope(&self) -> [f64; 2] {
        [self.coefficients.y, self.coefficients.z]
    }

    /// Returns the disparity of a pixel, `[u, v, d]`, less the plane's.
    pub fn residual(&self, &[u, v, d]: &[f64; 3]) -> f64 {
        d - self.disparity([u, v])
    }
}

fn row([u0, v0]: [f64; 2], u: f64, v: f64) -> Vector3<f64> {
    Vector3::new(1.0, u - u0, v - v0)
}

/// The coefficients of the plane with the least squared residuals; `None` if the pixels are on a line.
fn least_squares(origin: [f64; 2], pixels: &mut dyn Iterator<Item = &[f64; 3]>) -> Option<Vector3<f64>> {
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for &[u, v, d] in pixels {
        let row = row(origin, u, v);
        matrix += row * row.transpose();
        right += row * d;
    }
    // Pixels are whole numbers, so that any three off a line have a determinant of at least 1.
    (matrix.determinant() > 0.5).then(|| matrix.cholesky().map(|matrix| matrix.solve(&right)))?
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::FloatImage;

    const SIZE: [usize; 2] = [160, 120];
    const GEOMETRY: Geometry = Geometry { focal_px: 240.0, baseline_mm: 25.0, principal_point: [75.0, 62.0], doffs: -1.5 };
    const DISTANCE_MM: f64 = 500.0;

    /// The depth of a wall at the distance, which recedes by these angles to the right and down, where a pixel sees it: the ray
    /// `Z (x, y, 1)` meets `Z = distance + X tan(right) + Y tan(down)`.
    fn depth(pixel: [usize; 2], [right, down]: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|axis| (pixel[axis] as f64 - GEOMETRY.principal_point[axis]) / GEOMETRY.focal_px);
        DISTANCE_MM / (1.0 - x * right.to_radians().tan() - y * down.to_radians().tan())
    }

    /// Disparities of such a wall, with noise of a standard deviation in pixels, and shares of the pixels that are invalid and
    /// that are wrong.
    fn wall(angles: [f64; 2], deviation: f64, [invalid, wrong]: [f64; 2]) -> DisparityMap {
        let mut random = fastrand::Rng::with_seed(9);
        let disparity = |pixel: [usize; 2]| {
            let d = GEOMETRY.focal_px * GEOMETRY.baseline_mm / depth(pixel, angles) - GEOMETRY.doffs;
            let noise = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
            let kind = random.f64();
            match kind {
                _ if kind < invalid => f32::INFINITY,
                _ if kind < invalid + wrong => (d + 5.0 + 20.0 * random.f64()) as f32,
                _ => (d + deviation * noise) as f32,
            }
        };
        DisparityMap::from_float(&FloatImage::new(SIZE[0], SIZE[1], ImageRegion::whole(SIZE).pixels().map(disparity).collect()))
    }

    #[track_caller]
    fn assert_near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
    }

    #[test]
    fn a_wall_is_where_it_is() {
        for angles in [[0.0, 0.0], [20.0, 0.0], [0.0, -15.0], [12.0, 25.0]] {
            let wall = wall(angles, 0.0, [0.0, 0.0]);
            let (metrics, plane) = WallMetrics::new(&wall, Some(&GEOMETRY), ImageRegion::whole(SIZE), Some(DISTANCE_MM)).unwrap();
            let place = metrics.place.unwrap();
            assert_eq!((metrics.fill_rate, metrics.outliers), (100.0, 0.0));
            // Only the rounding to steps of 1/64 pixel, of which the error is uniform, is left.
            assert!(metrics.rms_px <= 1.0 / 64.0 / 12.0f64.sqrt() * 1.02, "{metrics:?}");
            assert_near(place.distance_mm, DISTANCE_MM, 0.02);
            assert_near(place.z_accuracy_percent.unwrap(), 0.0, 0.05);
            assert_near(place.recedes_right_deg, angles[0], 0.02);
            assert_near(place.recedes_down_deg, angles[1], 0.02);
            let tangents = angles.map(|angle| angle.to_radians().tan());
            assert_near(place.tilt_deg, tangents[0].hypot(tangents[1]).atan().to_degrees(), 0.02);
            assert_near(plane.disparity([10.0, 20.0]), 6000.0 / depth([10, 20], angles) + 1.5, 0.01);
        }
    }

    #[test]
    fn noise_and_bias_are_measured() {
        let (deviation, angles) = (0.2, [15.0, -10.0]);
        let shares = [0.1, 0.0];
        let wall = wall(angles, deviation, shares);
        let region = ImageRegion { left: 30, top: 20, width: 100, height: 80 };
        let (metrics, _) = WallMetrics::new(&wall, Some(&GEOMETRY), region, Some(490.0)).unwrap();
        let place = metrics.place.unwrap();
        // Without 0.5 % at both ends, a normal distribution has 0.962 times its standard deviation.
        let trimmed = 0.962 * deviation;
        assert_near(metrics.rms_px, trimmed, 0.02 * deviation);
        assert_near(metrics.fill_rate, 90.0, 1.5);
        assert_eq!(metrics.outliers, 0.0);
        // A pixel of disparity moves a point along its ray by Z^2 / (f B) mm ahead; its distance from the plane is what of that
        // is along the normal, in proportion to how far the plane is along the ray and along the normal: n (x, y, 1) Z = h.
        let tangents = angles.map(|angle| angle.to_radians().tan());
        let height = DISTANCE_MM / (1.0 + tangents[0].powi(2) + tangents[1].powi(2)).sqrt();
        let squares: f64 = region.pixels().map(|pixel| (depth(pixel, angles) * height / 6000.0).powi(2)).sum();
        let expected = trimmed * (squares / region.area() as f64).sqrt();
        assert_near(place.rms_mm, expected, 0.02 * expected);
        assert_near(place.rms_percent, 100.0 * expected / DISTANCE_MM, 0.002 * place.rms_percent + 0.02);
        assert_near(place.z_accuracy_percent.unwrap(), 100.0 * 10.0 / 490.0, 0.1);
    }

    #[test]
    fn mismatches_are_outliers_and_do_not_tilt_the_wall() {
        let wall = wall([10.0, 5.0], 0.1, [0.0, 0.2]);
        let (metrics, _) = WallMetrics::new(&wall, Some(&GEOMETRY), ImageRegion::whole(SIZE), None).unwrap();
        let place = metrics.place.unwrap();
        assert_near(metrics.outliers, 20.0, 1.0);
        assert_near(place.recedes_right_deg, 10.0, 0.1);
        assert_near(place.distance_mm, DISTANCE_MM, 0.5);
        assert_eq!(place.z_accuracy_percent, None);
        assert!(metrics.rms_px > 1.0, "most mismatches count: {metrics:?}");
    }

    #[test]
    fn without_geometry_there_are_pixels_only() {
        let wall = wall([0.0, 0.0], 0.1, [0.25, 0.0]);
        let (metrics, _) = WallMetrics::new(&wall, None, ImageRegion::middle(SIZE), None).unwrap();
        assert_eq!(metrics.place, None);
        assert_near(metrics.rms_px, 0.096, 0.003);
        assert_near(metrics.fill_rate, 75.0, 2.0);
        let json = serde_json::to_value(metrics).unwrap();
        assert_eq!(json.as_object().unwrap().keys().collect::<Vec<_>>(), ["fill_rate", "outliers", "rms_px"]);
    }

    #[test]
    fn what_is_no_wall_is_refused() {
        let message = |map: &DisparityMap, region| WallMetrics::new(map, Some(&GEOMETRY), region, None).unwrap_err().to_string();
        let wall = wall([0.0, 0.0], 0.0, [0.0, 0.0]);
        assert!(
            message(&wall, ImageRegion { left: 1, ..ImageRegion::whole(SIZE) }).contains("leaves the image of 160x120 pixels")
        );
        let small = ImageRegion { left: 70, top: 50, width: 9, height: 11 };
        assert!(message(&wall, small).contains("only 99 pixels have a disparity"));
        // Beyond infinity, pixels have no depth.
        let behind = wall.map(|_| DisparityMap::from_float(&FloatImage::filled(1, 1, 1.0)).get(0, 0));
        assert!(message(&behind, ImageRegion::whole(SIZE)).contains("only 0 pixels"));
        // A wall that recedes so much that the optical axis does not meet it.
        let steep =
            FloatImage::new(SIZE[0], SIZE[1], ImageRegion::whole(SIZE).pixels().map(|[u, _]| 0.5 * (u as f32 - 80.0)).collect());
        assert!(message(&DisparityMap::from_float(&steep), ImageRegion::whole(SIZE)).contains("does not meet the optical axis"));
    }

    /// A plane with noise of this standard deviation, and a share of pixels that are anywhere.
    fn pixels(deviation: f64, wrong: f64) -> Vec<[f64; 3]> {
        let mut random = fastrand::Rng::with_seed(5);
        (0..60 * 40)
            .map(|k| {
                let [u, v] = [f64::from(k % 60 + 100), f64::from(k / 60 + 20)];
                // The sum of 12 uniform numbers is nearly normal.
                let noise = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
                let d = 20.0 + 0.03 * (u - 130.0) - 0.05 * (v - 40.0) + deviation * noise;
                [u, v, if random.f64() < wrong { 60.0 * random.f64() } else { d }]
            })
            .collect()
    }

    #[test]
    fn planes_are_found_in_spite_of_noise_and_mismatches() {
        for (deviation, wrong, tolerance) in [(0.0, 0.0, 1e-9), (0.1, 0.0, 0.01), (0.1, 0.2, 0.01), (0.1, 0.45, 0.02)] {
            let plane = PlaneFit::new(&pixels(deviation, wrong)).unwrap();
            let [right, down] = plane.slope();
            // Slopes matter by how much they change the disparity at the border.
            let errors = [plane.disparity([130.0, 40.0]) - 20.0, 30.0 * (right - 0.03), 20.0 * (down + 0.05)];
            assert!(errors.iter().all(|error| error.abs() <= tolerance), "{deviation}, {wrong}: {errors:?}");
        }
        let plane = PlaneFit::new(&pixels(0.0, 0.0)).unwrap();
        assert!((plane.residual(&[130.0, 40.0, 21.5]) - 1.5).abs() < 1e-9, "{plane:?}");
    }

    #[test]
    fn too_few_pixels_are_refused() {
        let message = |pixels: &[[f64; 3]]| PlaneFit::new(pixels).unwrap_err().to_string();
        assert!(message(&[]).contains("only 0 pixels have a disparity, a plane takes at least 100"));
        assert!(message(&pixels(0.0, 0.0)[..99]).contains("only 99 pixels"));
        let line: Vec<[f64; 3]> = (0..200).map(|k| [f64::from(k), 2.0 * f64::from(k), 5.0]).collect();
        assert!(message(&line).contains("on a line"));
        assert!(message(&[[3.0, 4.0, 5.0]; 100]).contains("on a line"));
    }
}
