//! The geometry of views: where one was taken and how it is turned, the directions of its baseline and the epipolar errors of its
//! matches, the rotation that all views share, and the homographies that turn the frames as if the camera had moved in its image
//! plane.

use multiscopic_core::View;
use nalgebra::{DMatrix, Matrix3, Rotation3, Vector2, Vector3};

/// A shift of the corners below which a frame is left as it is, in pixels: resampling would do more harm.
const NEGLIGIBLE: f64 = 0.05;
/// The squared distance of the views from an axis, in baselines, up to which they do not determine the rotation about it.
const UNDETERMINED: f64 = 0.01;

/// A pinhole camera, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    pub focal_px: f64,
    pub principal_point: [f64; 2],
}

impl Pinhole {
    /// The ray through a pixel.
    pub fn ray(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        Vector3::new((u - self.principal_point[0]) / self.focal_px, (v - self.principal_point[1]) / self.focal_px, 1.0)
    }

    /// The pixel of a ray, in focal lengths from the optical axis.
    pub fn pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.focal_px * x + self.principal_point[0], self.focal_px * y + self.principal_point[1]]
    }
}

/// The differences of a view from the centre. At the nominal values, the baseline is the only one.
///
/// Rays are `[x, y, 1]` in the centre's camera: to the right, down and ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewModel {
    /// The rotation from rays of the centre to those of the view, as an axis times an angle in radians.
    pub rotation: Vector3<f64>,
    /// The natural logarithm of its scale, relative to the centre.
    pub log_scale: f64,
    /// The shift of its image to the right and down, in focal lengths: a rotation without its perspective.
    pub shift: Vector2<f64>,
    /// The place where it was taken, in baselines.
    pub position: Vector3<f64>,
}

impl ViewModel {
    /// The centre itself.
    pub const NEUTRAL: ViewModel = ViewModel {
        rotation: Vector3::new(0.0, 0.0, 0.0),
        log_scale: 0.0,
        shift: Vector2::new(0.0, 0.0),
        position: Vector3::new(0.0, 0.0, 0.0),
    };

    /// The number of parameters.
    pub const LEN: usize = 9;

    /// The parameters in a row: rotation, scale, shift and position.
    pub fn to_array(self) -> [f64; ViewModel::LEN] {
        let ViewModel { rotation: r, log_scale, shift: s, position: p } = self;
        [r.x, r.y, r.z, log_scale, s.x, s.y, p.x, p.y, p.z]
    }

    /// From parameters in a row.
    pub fn from_array([rx, ry, rz, log_scale, sx, sy, px, py, pz]: [f64; ViewModel::LEN]) -> ViewModel {
        ViewModel {
            rotation: Vector3::new(rx, ry, rz),
            log_scale,
            shift: Vector2::new(sx, sy),
            position: Vector3::new(px, py, pz),
        }
    }

    /// Returns the projection of rays into the view.
    pub fn projection(&self) -> Projection {
        let scale = self.log_scale.exp();
        let image = Matrix3::new(scale, 0.0, self.shift.x, 0.0, scale, self.shift.y, 0.0, 0.0, 1.0);
        Projection { matrix: image * Rotation3::new(self.rotation), position: self.position }
    }
}

/// The projection of the centre's rays into a view.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    matrix: Matrix3<f64>,
    position: Vector3<f64>,
}

impl Projection {
    /// From rays of the centre to those of the view, scaled, for points at infinity.
    pub fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }

    /// Returns the place at which the view shows a ray of the centre, in focal lengths from the optical axis, if the point is
    /// so far away that a camera one baseline to the right shows it `disparity` focal lengths to the left.
    pub fn project(&self, ray: Vector3<f64>, disparity: f64) -> [f64; 2] {
        let seen = self.matrix * (ray - disparity * self.position);
        [seen.x / seen.z, seen.y / seen.z]
    }
}

/// Unit vectors along and across the baseline of a view, to the right and down. Opposite views share them: along points to
/// the right, or down for views in the centre's column, and across points down, or to the right for those.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    pub along: [f64; 2],
    pub across: [f64; 2],
    /// The motion of a match along the baseline with each pixel of disparity.
    pub step: f64,
}

impl Direction {
    pub fn of(view: View) -> Direction {
        let [x, y] = [view.right(), view.down()].map(f64::from);
        let length = x.hypot(y);
        let sign = if x < 0.0 || (x == 0.0 && y < 0.0) { -length } else { length };
        let along @ [x, y] = [x / sign, y / sign];
        let across = if x == 0.0 { [y, x] } else { [-y, x] };
        Direction { along, across, step: -sign }
    }
}

/// Returns the direction across the baseline of a view, in which a match is off its epipolar line: a unit vector to the right
/// and down.
pub fn across(view: View) -> [f64; 2] {
    Direction::of(view).across
}

/// A corner of the centre, and the epipolar error of its match in a view, as Sampson (1982) measures it: see
/// [`Residual::sampson_px`](crate::files::Residual::sampson_px).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarError {
    /// The corner in the centre image, in pixels.
    pub pixel: [f64; 2],
    /// The error in the images, in pixels: above 0 if the match is too far to the right, for views in the centre's column, or
    /// too far down, for others.
    pub before_px: f64,
    /// The same after rectification.
    pub after_px: f64,
}

/// The rotation from the centre's rays to axes along which the views stand: the stage's.
///
/// The axes are those by which the positions, at the `nominal` ones of each view, are met best. Where the positions do not
/// determine a rotation, as that about a single baseline, there is none.
pub fn common_rotation(positions: &[(Vector3<f64>, Vector3<f64>)]) -> Rotation3<f64> {
    let mut rotation = Rotation3::identity();
    for _ in 0..20 {
        let (mut matrix, mut right) = (Matrix3::identity() * 1e-4, Vector3::zeros());
        for (position, nominal) in positions {
            let turned = rotation * position;
            // A small rotation `w` moves `turned` by `w x turned`.
            let by_rotation = -turned.cross_matrix();
            matrix += by_rotation.transpose() * by_rotation;
            right += by_rotation.transpose() * (nominal - turned);
        }
        let Some(step) = matrix.cholesky().map(|cholesky| cholesky.solve(&right)) else { break };
        rotation = Rotation3::new(step) * rotation;
        if step.norm() < 1e-9 {
            break;
        }
    }
    rotation
}

/// The rotation vector from the stage's axes to the camera's, and its standard deviations, in degrees, by the models of views and
/// the covariance of their parameters.
///
/// The deviations are those of the views' positions, or more if the positions agree worse with any rotation than they say. They
/// are NaN about axes that the positions do not determine, as that of a single baseline.
pub fn common_rotation_with_deviation(
    models: &[ViewModel],
    covariance: &DMatrix<f64>,
    nominal: &[Vector3<f64>],
) -> ([f64; 3], [f64; 3]) {
    let positions: Vec<_> = models.iter().map(|model| model.position).zip(nominal.iter().copied()).collect();
    let rotation = common_rotation(&positions);
    let (mut matrix, mut error, mut count) = (Matrix3::zeros(), 0.0, 0.0);
    // What each view's position, but for the length of its baseline, adds to the rotation.
    let mut by_positions = DMatrix::zeros(3, 3 * models.len());
    for (k, (position, nominal)) in positions.iter().enumerate() {
        let turned = rotation * position;
        let by_rotation = -turned.cross_matrix();
        let across = Matrix3::identity() - nominal * nominal.transpose() / nominal.norm_squared();
        let to_axes = across * rotation.matrix();
        let of_position = covariance_of(covariance, k, k);
        matrix += by_rotation.transpose() * by_rotation;
        by_positions.fixed_columns_mut::<3>(3 * k).copy_from(&(by_rotation.transpose() * to_axes));
        error += (across * (nominal - turned)).norm_squared() / ((to_axes * of_position * to_axes.transpose()).trace() / 2.0);
        count += 2.0;
    }
    let mut spread = Matrix3::zeros();
    for (k, n) in (0..models.len()).flat_map(|k| (0..models.len()).map(move |n| (k, n))) {
        let [of_k, of_n] = [k, n].map(|view| by_positions.fixed_columns::<3>(3 * view).into_owned());
        spread += of_k * covariance_of(covariance, k, n) * of_n.transpose();
    }
    let is_determined = |axis: usize| matrix[(axis, axis)] > UNDETERMINED;
    let Some(inverse) = (matrix + Matrix3::identity() * UNDETERMINED).try_inverse() else {
        return ([f64::NAN; 3], [f64::NAN; 3]);
    };
    let covariance = inverse * spread * inverse.transpose() * f64::max(1.0, error / f64::max(1.0, count - 3.0));
    let deviation = |axis: usize| if is_determined(axis) { covariance[(axis, axis)].sqrt().to_degrees() } else { f64::NAN };
    (rotation.scaled_axis().map(f64::to_degrees).into(), [0, 1, 2].map(deviation))
}

/// The covariance of the positions of two views, in that of all parameters.
fn covariance_of(covariance: &DMatrix<f64>, k: usize, n: usize) -> Matrix3<f64> {
    covariance.fixed_view::<3, 3>((k + 1) * ViewModel::LEN - 3, (n + 1) * ViewModel::LEN - 3).into()
}

/// From pixels of a rectified frame to those of its image.
#[derive(Clone, Copy, Debug)]
pub struct Map {
    /// The camera of the images.
    pub source: Pinhole,
    /// The camera of the rectified frames.
    pub rectified: Pinhole,
    /// From the rays of rectified frames to those of the image, scaled.
    pub matrix: Matrix3<f64>,
}

impl Map {
    /// The pixel of the image that a rectified pixel shows.
    pub fn at(&self, pixel: [f64; 2]) -> [f64; 2] {
        let seen = self.matrix * self.rectified.ray(pixel);
        self.source.pixel([seen.x / seen.z, seen.y / seen.z])
    }

    /// The largest distance by which a corner of the image moves, in pixels.
    pub fn border_px(&self, [width, height]: [usize; 2]) -> f64 {
        let [right, bottom] = [width, height].map(|side| side as f64 - 1.0);
        let distance = |corner: [f64; 2]| {
            let [u, v] = self.at(corner);
            (u - corner[0]).hypot(v - corner[1])
        };
        [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(distance).into_iter().fold(0.0, f64::max)
    }

    /// Returns true if the image is left as it is.
    pub fn is_negligible(&self, size: [usize; 2]) -> bool {
        self.border_px(size) < NEGLIGIBLE
    }

    /// The homography from rectified pixels to those of the image, in rows, with 1 in its corner.
    pub fn homography(&self) -> [[f64; 3]; 3] {
        let camera =
            |Pinhole { focal_px: f, principal_point: [cx, cy] }: Pinhole| Matrix3::new(f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0);
        let inverse = camera(self.rectified).try_inverse().expect("focal lengths are above 0");
        let matrix = camera(self.source) * self.matrix * inverse;
        let matrix = matrix / matrix[(2, 2)];
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_views_share_directions() {
        let direction = |i, j| Direction::of(View::new(i, j).unwrap());
        let (right, down) = ([1.0, 0.0], [0.0, 1.0]);
        assert_eq!(direction(1, 0), Direction { along: right, across: down, step: -1.0 });
        assert_eq!(direction(-4, 0), Direction { along: right, across: down, step: 4.0 });
        assert_eq!(direction(0, -1), Direction { along: down, across: right, step: 1.0 });
        assert_eq!(direction(0, 2), Direction { along: down, across: right, step: -2.0 });
        assert_eq!(direction(3, 4), Direction { along: [0.6, 0.8], across: [-0.8, 0.6], step: -5.0 });
        assert_eq!(direction(-3, -4), Direction { step: 5.0, ..direction(3, 4) });
        assert_eq!(direction(-3, 4), Direction { along: [0.6, -0.8], across: [0.8, 0.6], step: 5.0 });
    }
}
