//! The distortion of a lens.

use std::{f64::consts::FRAC_PI_2, fmt};

use nalgebra::{Rotation3, Vector3};

/// A model of distortion. Coefficients are in the order of OpenCV, ROS and Kalibr.
///
/// With `r² = x² + y²`, the ideal coordinates `(x, y)` become `(x', y')`:
///
/// ```text
/// plumb bob, rational    x' = x R + 2 p1 x y + p2 (r² + 2 x²)
///                        y' = y R + p1 (r² + 2 y²) + 2 p2 x y
///                        R  = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
/// equidistant            x' = x T / r,  y' = y T / r
///                        T  = t (1 + k1 t² + k2 t⁴ + k3 t⁶ + k4 t⁸),  t = atan r
/// thin prism             the rational x' + s1 r² + s2 r⁴ and y' + s3 r² + s4 r⁴, and with their ray
///                        (X, Y, Z) = R (x', y', 1), R = Ry(-tau_y) Rx(-tau_x),
///                        x" = R33 X / Z - R13,  y" = R33 Y / Z - R23
/// ```
///
/// All but the equidistant one are those of OpenCV's `projectPoints` (module `calib3d`), after Brown (1966) and Conrady (1919),
/// with the sensor tilted after Scheimpflug (Louhichi et al., 2007). The equidistant one is that of its
/// `fisheye::projectPoints`, after Kannala and Brandt (2006).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensModel {
    /// `k1 k2 p1 p2 k3`, with `k4` to `k6` equal to 0: ROS's `plumb_bob`. Kalibr's `radtan` is the same without `k3`.
    PlumbBob,
    /// `k1 k2 p1 p2 k3 k4 k5 k6`: ROS's `rational_polynomial`.
    Rational,
    /// The coefficients of the rational model, `s1 s2 s3 s4` of a thin prism, and the angles `tau_x tau_y` of a tilted sensor in
    /// radians: OpenCV's 14. In ROS it is a `rational_polynomial` too.
    ThinPrism,
    /// `k1 k2 k3 k4`, for fisheyes: `equidistant` of ROS and Kalibr.
    Equidistant,
}

impl LensModel {
    /// All models.
    pub const ALL: [LensModel; 4] = [LensModel::PlumbBob, LensModel::Rational, LensModel::ThinPrism, LensModel::Equidistant];

    /// The name in a `camera.toml`.
    pub fn name(self) -> &'static str {
        match self {
            LensModel::PlumbBob => "plumb_bob",
            LensModel::Rational => "rational",
            LensModel::ThinPrism => "thin_prism",
            LensModel::Equidistant => "equidistant",
        }
    }

    /// The names of the coefficients.
    pub fn coefficient_names(self) -> &'static [&'static str] {
        const OPENCV: [&str; 14] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"];
        match self {
            LensModel::PlumbBob => &OPENCV[..5],
            LensModel::Rational => &OPENCV[..8],
            LensModel::ThinPrism => &OPENCV,
            LensModel::Equidistant => &["k1", "k2", "k3", "k4"],
        }
    }
}

impl fmt::Display for LensModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Coefficients that do not describe a lens.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LensError {
    /// The model has another number of coefficients.
    #[error("{found} coefficients, but {model} has {} ({})", model.coefficient_names().len(), model.coefficient_names().join(" "))]
    Count {
        /// The model.
        model: LensModel,
        /// The number of coefficients given.
        found: usize,
    },
    /// A coefficient is not a finite number.
    #[error("{name} = {value}, which is not a finite number")]
    NotFinite {
        /// The name of the coefficient.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The sensor is tilted by a right angle or more.
    #[error("{name} = {value} radians, which is no tilt below a right angle")]
    Tilt {
        /// The name of the angle.
        name: &'static str,
        /// Its value in radians.
        value: f64,
    },
}

/// A lens: a model of distortion with its coefficients.
///
/// ```
/// use multiscopic::{Lens, LensModel};
/// let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.0, 0.0, 0.0])?;
/// let [x, y] = lens.distort([0.5, 0.0]).expect("within the range of the model");
/// assert!(0.4 < x && x < 0.5 && y == 0.0);
/// # Ok::<(), multiscopic::lens::LensError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    model: LensModel,
    /// Those that the model does not have are 0, in the order of [`LensModel::ThinPrism`] unless it is equidistant.
    coefficients: [f64; MOST_COEFFICIENTS],
    max_radius: f64,
}

/// The number of coefficients of the model that has the most.
const MOST_COEFFICIENTS: usize = 14;
/// The largest ideal radius, about 87 degrees off the optical axis. No picture of an ideal camera goes so far.
const LARGEST_RADIUS: f64 = 20.0;
/// The largest error of [`Lens::undistort`], in distorted normalised coordinates.
const TOLERANCE: f64 = 1e-12;

impl Lens {
    /// A lens without distortion.
    pub const IDEAL: Lens =
        Lens { model: LensModel::PlumbBob, coefficients: [0.0; MOST_COEFFICIENTS], max_radius: LARGEST_RADIUS };

    /// A lens with the coefficients named by [`LensModel::coefficient_names`].
    ///
    /// # Errors
    /// [`LensError`] if their number is wrong, one is not finite, or an angle is not below a right one.
    pub fn new(model: LensModel, coefficients: &[f64]) -> Result<Lens, LensError> {
        let names = model.coefficient_names();
        if coefficients.len() != names.len() {
            return Err(LensError::Count { model, found: coefficients.len() });
        }
        if let Some((name, value)) = names.iter().zip(coefficients).find(|(_, value)| !value.is_finite()) {
            return Err(LensError::NotFinite { name, value: *value });
        }
        let mut tilts = names.iter().zip(coefficients).filter(|(name, _)| name.starts_with("tau"));
        if let Some((name, value)) = tilts.find(|(_, value)| value.abs() >= FRAC_PI_2) {
            return Err(LensError::Tilt { name, value: *value });
        }
        let mut all = [0.0; MOST_COEFFICIENTS];
        all[..coefficients.len()].copy_from_slice(coefficients);
        let lens = Lens { model, coefficients: all, max_radius: LARGEST_RADIUS };
        Ok(Lens { max_radius: lens.first_fold(), ..lens })
    }

    /// The model.
    pub fn model(&self) -> LensModel {
        self.model
    }

    /// The coefficients of the model.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..self.model.coefficient_names().len()]
    }

    /// The end of the model, as an ideal radius: the distorted radius grows up to here. Beyond, polynomials
    /// fold back, and a distorted point would belong to several directions. At most 20.
    pub fn max_radius(&self) -> f64 {
        self.max_radius
    }

    /// The distorted coordinates of the ideal ones. `None` beyond [`max_radius`](Lens::max_radius).
    pub fn distort(&self, ideal: [f64; 2]) -> Option<[f64; 2]> {
        let ([x, y], _) = self.distort_with_slopes(ideal)?;
        let Some(tilt) = self.tilt() else { return Some([x, y]) };
        let ray = tilt * Vector3::new(x, y, 1.0);
        let project = |at: f64, axis: usize| tilt[(2, 2)] * at / ray.z - tilt[(axis, 2)];
        (ray.z > 0.0).then(|| [project(ray.x, 0), project(ray.y, 1)])
    }

    /// The ideal coordinates of the distorted ones, with an error of at most 1e-12 after they are distorted again. `None` for
    /// a point that no direction within [`max_radius`](Lens::max_radius) reaches.
    pub fn undistort(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        const MAX_STEPS: usize = 40;
        const MAX_HALVINGS: i32 = 20;
        let distorted = self.without_tilt(distorted)?;
        // The solution without tangential distortion, by bisection, as the radius grows. Then Newton's method.
        let target = distorted[0].hypot(distorted[1]);
        let (mut low, mut high) = (0.0, self.max_radius);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            match self.radial(middle) {
                Some([factor, _]) if middle * factor < target => low = middle,
                _ => high = middle,
            }
        }
        // Newton's method needs a slope, which is 0 at the end of the model.
        let scale = if target > 0.0 { low.min(0.9 * self.max_radius) / target } else { 0.0 };
        let [mut x, mut y] = distorted.map(|coordinate| coordinate * scale);
        let error = |[u, v]: [f64; 2]| (u - distorted[0]).hypot(v - distorted[1]);
        let (mut found, mut slopes) = self.distort_with_slopes([x, y])?;
        for _ in 0..MAX_STEPS {
            let [[xx, xy], [yx, yy]] = slopes;
            let determinant = xx * yy - xy * yx;
            if determinant <= 0.0 || xx <= 0.0 {
                return None;
            }
            if error(found) <= TOLERANCE {
                return Some([x, y]);
            }
            let (error_x, error_y) = (found[0] - distorted[0], found[1] - distorted[1]);
            let step = [(yy * error_x - xy * error_y) / determinant, (xx * error_y - yx * error_x) / determinant];
            // Near the end of the model, a whole step can leave it.
            let shorter = |halvings: i32| {
                let length = 0.5_f64.powi(halvings);
                let next = [x - length * step[0], y - length * step[1]];
                let (distorted, slopes) = self.distort_with_slopes(next)?;
                (error(distorted) < error(found)).then_some((next, distorted, slopes))
            };
            let next;
            (next, found, slopes) = (0..MAX_HALVINGS).find_map(shorter)?;
            [x, y] = next;
        }
        None
    }

    /// The rotation from the lens to a tilted sensor.
    fn tilt(&self) -> Option<Rotation3<f64>> {
        let [.., tau_x, tau_y] = self.coefficients;
        let about = |axis, tau: f64| Rotation3::from_axis_angle(&axis, -tau);
        ([tau_x, tau_y] != [0.0; 2]).then(|| about(Vector3::y_axis(), tau_y) * about(Vector3::x_axis(), tau_x))
    }

    /// The coordinates of a point that a tilted sensor sees as `distorted`.
    fn without_tilt(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        let Some(tilt) = self.tilt() else { return Some(distorted) };
        let [x, y] = [0, 1].map(|axis| (distorted[axis] + tilt[(axis, 2)]) / tilt[(2, 2)]);
        let ray = tilt.inverse() * Vector3::new(x, y, 1.0);
        (ray.z > 0.0).then(|| [ray.x / ray.z, ray.y / ray.z])
    }

    /// The distorted coordinates on a sensor without tilt and their derivatives: of `x'` by `x` and `y`, and of `y'` by both.
    fn distort_with_slopes(&self, [x, y]: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let r2 = x * x + y * y;
        let [factor, slope] = self.radial(r2.sqrt()).filter(|_| r2.sqrt() <= self.max_radius)?;
        let [p1, p2, s1, s2, s3, s4] = match self.model {
            LensModel::Equidistant => [0.0; 6],
            _ => [2, 3, 8, 9, 10, 11].map(|k| self.coefficients[k]),
        };
        let distorted = [
            x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + s2 * r2),
            y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + s4 * r2),
        ];
        let shared = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let [prism_x, prism_y] = [2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)];
        let slopes = [
            [factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x, shared + prism_x * y],
            [shared + prism_y * x, factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y],
        ];
        Some((distorted, slopes))
    }

    /// The distorted radius as a multiple of the ideal radius `r`, and the derivative of that factor by `r²`. `None` at
    /// or beyond a pole.
    fn radial(&self, r: f64) -> Option<[f64; 2]> {
        let r2 = r * r;
        match self.model {
            LensModel::PlumbBob | LensModel::Rational | LensModel::ThinPrism => {
                let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.coefficients;
                let (top, top_slope) = cubic([k1, k2, k3], r2);
                let (bottom, bottom_slope) = cubic([k4, k5, k6], r2);
                (bottom > 0.0).then(|| [top / bottom, (top_slope * bottom - top * bottom_slope) / (bottom * bottom)])
            }
            LensModel::Equidistant => {
                let [k1, k2, k3, k4, ..] = self.coefficients;
                if r < 1e-4 {
                    return Some([1.0 + (k1 - 1.0 / 3.0) * r2, k1 - 1.0 / 3.0]);
                }
                let t = r.atan();
                let t2 = t * t;
                let distorted = t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
                let by_t = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
                let by_r = by_t / (1.0 + r2);
                Some([distorted / r, (by_r - distorted / r) / (2.0 * r2)])
            }
        }
    }

    /// The ideal radius up to which the distorted radius grows.
    fn first_fold(&self) -> f64 {
        const STEP: f64 = 1.0 / 512.0;
        let grows = |r: f64| self.radial(r).is_some_and(|[factor, slope]| factor + 2.0 * r * r * slope > 0.0);
        let steps = (LARGEST_RADIUS / STEP) as usize;
        let Some(beyond) = (1..=steps).map(|step| step as f64 * STEP).find(|&r| !grows(r)) else {
            return LARGEST_RADIUS;
        };
        let (mut low, mut high) = (beyond - STEP, beyond);
        for _ in 0..40 {
            let middle = (low + high) / 2.0;
            if grows(middle) { low = middle } else { high = middle }
        }
        low
    }
}

/// `1 + a q + b q² + c q³` and its derivative.
fn cubic([a, b, c]: [f64; 3], q: f64) -> (f64, f64) {
    (1.0 + q * (a + q * (b + q * c)), a + q * (2.0 * b + q * 3.0 * c))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLUMB_BOB: [f64; 5] = [-0.25, 0.08, 0.0012, -0.0007, -0.01];
    const RATIONAL: [f64; 8] = [0.4, -0.15, 0.0005, 0.0011, 0.02, 0.7, -0.05, 0.015];
    const THIN_PRISM: [f64; 14] =
        [0.4, -0.15, 0.0005, 0.0011, 0.02, 0.7, -0.05, 0.015, 0.0012, -0.0004, -0.0009, 0.0003, 0.03, -0.02];
    const EQUIDISTANT: [f64; 4] = [-0.013, 0.021, -0.018, 0.004];

    /// Ideal and distorted coordinates.
    type Points = &'static [([f64; 2], [f64; 2])];

    fn close(a: [f64; 2], b: [f64; 2], tolerance: f64) -> bool {
        (a[0] - b[0]).hypot(a[1] - b[1]) <= tolerance
    }

    #[test]
    fn distorts_as_opencv_does() {
        // cv2.projectPoints and cv2.fisheye.projectPoints of OpenCV 5.0.0 with the camera matrix numpy.eye(3), no rotation and
        // no translation, on points with z = 1.
        let no_tilt = [&THIN_PRISM[..12], &[0.0; 2]].concat();
        let cases: [(LensModel, &[f64], Points); 5] = [
            (
                LensModel::PlumbBob,
                &PLUMB_BOB,
                &[
                    ([0.0, 0.0], [0.0, 0.0]),
                    ([0.3, -0.2], [0.290288009, -0.193_430_006]),
                    ([-0.45, 0.31], [-0.420_324_843_634_348_1, 0.289_771_442_948_106_5]),
                    ([0.05, 0.4], [0.048_002_979_492_187_5, 0.385_128_835_937_5]),
                ],
            ),
            (
                LensModel::Rational,
                &RATIONAL,
                &[
                    ([0.3, -0.2], [0.289_086_871_094_035_36, -0.192_564_247_396_023_6]),
                    ([-0.45, 0.31], [-0.412_631_259_600_597_93, 0.284_632_662_391_523_1]),
                    ([0.05, 0.4], [0.047_895_510_919_749_82, 0.381_815_337_357_998_6]),
                ],
            ),
            (
                LensModel::ThinPrism,
                &no_tilt,
                &[
                    ([0.3, -0.2], [0.289_236_111_094_035_35, -0.192_676_177_396_023_6]),
                    ([-0.45, 0.31], [-0.412_308_604_384_597_93, 0.284_390_670_979_523_1]),
                    ([0.05, 0.4], [0.048_079_948_419_749_82, 0.381_677_009_232_998_6]),
                ],
            ),
            (
                LensModel::ThinPrism,
                &THIN_PRISM,
                &[
                    ([0.0, 0.0], [0.0, 0.0]),
                    ([0.3, -0.2], [0.289_295_726_315_353_6, -0.192_590_467_880_534_75]),
                    ([-0.45, 0.31], [-0.412_507_941_762_833_45, 0.284_351_758_143_346_46]),
                    ([0.05, 0.4], [0.048_694_148_013_307_74, 0.386_678_654_914_649_7]),
                    ([-0.6, -0.5], [-0.493_424_879_489_598_96, -0.412_738_185_194_390_8]),
                ],
            ),
            (
                LensModel::Equidistant,
                &EQUIDISTANT,
                &[
                    ([0.0, 0.0], [0.0, 0.0]),
                    ([0.3, -0.2], [0.287_558_266_021_923_3, -0.191_705_510_681_282_22]),
                    ([-0.9, 0.7], [-0.668_804_934_246_963_4, 0.520_181_615_525_416]),
                    ([1.5, 2.0], [0.706_076_210_994_016_1, 0.941_434_947_992_021_4]),
                ],
            ),
        ];
        for (model, coefficients, points) in cases {
            let lens = Lens::new(model, coefficients).unwrap();
            assert_eq!(lens.coefficients(), coefficients);
            for &(ideal, distorted) in points {
                assert!(close(lens.distort(ideal).unwrap(), distorted, 1e-14), "{model}, {ideal:?}: {:?}", lens.distort(ideal));
                assert!(close(lens.undistort(distorted).unwrap(), ideal, 1e-11), "{model}, {ideal:?}");
            }
        }
    }

    #[test]
    fn undistorting_inverts_distorting_up_to_the_end_of_the_model() {
        for (model, coefficients) in [
            (LensModel::PlumbBob, &PLUMB_BOB[..]),
            (LensModel::Rational, &RATIONAL),
            (LensModel::ThinPrism, &THIN_PRISM),
            (LensModel::Equidistant, &EQUIDISTANT),
        ] {
            let lens = Lens::new(model, coefficients).unwrap();
            for step in 0..400 {
                let (angle, radius) = (0.1 * f64::from(step), 0.97 * lens.max_radius().min(4.0) * f64::from(step) / 400.0);
                let ideal = [radius * angle.cos(), radius * angle.sin()];
                let distorted = lens.distort(ideal).unwrap();
                let found = lens.undistort(distorted).unwrap_or_else(|| panic!("{model}: {ideal:?}"));
                assert!(close(found, ideal, 1e-9), "{model}: {found:?} instead of {ideal:?}");
            }
        }
    }

    #[test]
    fn a_model_ends_where_it_folds_back() {
        // r (1 + k1 r²) has its largest value at r = sqrt(-1 / (3 k1)): 2 r / 3.
        let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let end = (1.0 / 0.75_f64).sqrt();
        assert!((lens.max_radius() - end).abs() < 1e-9, "{}", lens.max_radius());
        assert_eq!(lens.distort([end + 1e-6, 0.0]), None);
        assert!(lens.distort([end - 1e-6, 0.0]).is_some());
        let largest = 2.0 * end / 3.0;
        assert!(lens.undistort([0.0, largest - 1e-6]).is_some());
        assert_eq!(lens.undistort([0.0, largest + 1e-6]), None);
        assert_eq!(lens.undistort([5.0, -3.0]), None);
        // A pole: 1 - r² / 4 is 0 at r = 2.
        let lens = Lens::new(LensModel::Rational, &[0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0]).unwrap();
        assert!((lens.max_radius() - 2.0).abs() < 1e-6, "{}", lens.max_radius());
        // Without distortion nothing folds.
        assert_eq!(Lens::new(LensModel::PlumbBob, &[0.0; 5]), Ok(Lens::IDEAL));
        assert!(close(Lens::IDEAL.undistort([-3.0, 2.0]).unwrap(), [-3.0, 2.0], 1e-14));
        assert_eq!(Lens::IDEAL.distort([f64::NAN, 0.0]), None);
        assert_eq!(Lens::IDEAL.undistort([f64::NAN, 0.0]), None);
    }

    #[test]
    fn the_coefficients_are_checked() {
        let message = |model, coefficients: &[f64]| Lens::new(model, coefficients).unwrap_err().to_string();
        assert_eq!(message(LensModel::Equidistant, &[0.0; 5]), "5 coefficients, but equidistant has 4 (k1 k2 k3 k4)");
        assert_eq!(message(LensModel::PlumbBob, &[0.0, 0.0, f64::NAN, 0.0, 0.0]), "p1 = NaN, which is not a finite number");
        let upright = [&[0.0; 13][..], &[1.6]].concat();
        assert!(message(LensModel::ThinPrism, &upright).starts_with("tau_y = 1.6 radians, which is no tilt"));
    }
}
