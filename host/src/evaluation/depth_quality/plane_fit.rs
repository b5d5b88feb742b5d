//! Planes fitted to disparities.

use nalgebra::{Matrix3, Vector3};

use crate::{
    alignment::median,
    error::{Error, Result},
};

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
    /// Fits a plane to disparities at pixels, `[u, v, d]`, of which fewer than half may be wrong by any amount: the least median
    /// of squares over random samples (Rousseeuw, 1984), then least squares over the pixels near the plane. Disparities, unlike
    /// depths, have the same noise everywhere.
    ///
    /// # Errors
    /// [`Error::Usage`] if there are fewer than 100 pixels, or all are on a line.
    pub fn new(pixels: &[[f64; 3]]) -> Result<PlaneFit> {
        if pixels.len() < FEWEST {
            let count = pixels.len();
            return Err(Error::Usage(format!("only {count} pixels have a disparity, a plane takes at least {FEWEST}")));
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
        let on_a_line = || Error::Usage("all pixels that have a disparity are on a line, which determines no plane".into());
        let (_, mut plane) = best.ok_or_else(on_a_line)?;
        for _ in 0..STEPS {
            let limit = NEAR * deviation(&plane, &mut pixels.iter()).max(LEAST_DEVIATION);
            let next = fit(&mut pixels.iter().filter(|pixel| plane.residual(pixel).abs() <= limit)).ok_or_else(on_a_line)?;
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

    /// How much its disparity grows with each pixel to the right and down.
    pub fn slope(&self) -> [f64; 2] {
        [self.coefficients.y, self.coefficients.z]
    }

    /// How far the disparity of a pixel, `[u, v, d]`, is above the plane's.
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
