//! The homographies that turn the frames as if the camera had moved in its image plane.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::adjustment::Adjustment;

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

/// The rotation vector from the stage's axes to the camera's, and its standard deviations, in degrees.
///
/// The deviations are those of the views' positions, or more if the positions agree worse with any rotation than they say. They
/// are NaN about axes that the positions do not determine, as that of a single baseline.
pub fn common_rotation_with_deviation(adjustment: &Adjustment, nominal: &[Vector3<f64>]) -> ([f64; 3], [f64; 3]) {
    let positions: Vec<_> = adjustment.models.iter().map(|model| model.position).zip(nominal.iter().copied()).collect();
    let rotation = common_rotation(&positions);
    let (mut matrix, mut spread, mut error, mut count) = (Matrix3::zeros(), Matrix3::zeros(), 0.0, 0.0);
    for ((position, nominal), deviations) in positions.iter().zip(&adjustment.deviations) {
        let turned = rotation * position;
        let by_rotation = -turned.cross_matrix();
        // A deviation along the move is one of its length.
        let across = Matrix3::identity() - nominal * nominal.transpose() / nominal.norm_squared();
        let covariance = Matrix3::from_diagonal(&Vector3::new(deviations[4], deviations[5], deviations[6]).map(|d| d * d));
        let covariance = across * rotation.matrix() * covariance * rotation.matrix().transpose() * across;
        matrix += by_rotation.transpose() * by_rotation;
        spread += by_rotation.transpose() * covariance * by_rotation;
        let off = across * (nominal - turned);
        error += off.norm_squared() / (covariance.trace() / 2.0);
        count += 2.0;
    }
    let is_determined = |axis: usize| matrix[(axis, axis)] > UNDETERMINED;
    let Some(inverse) = (matrix + Matrix3::identity() * UNDETERMINED).try_inverse() else {
        return ([f64::NAN; 3], [f64::NAN; 3]);
    };
    let covariance = inverse * spread * inverse.transpose() * f64::max(1.0, error / f64::max(1.0, count - 3.0));
    let deviation = |axis: usize| if is_determined(axis) { covariance[(axis, axis)].sqrt().to_degrees() } else { f64::NAN };
    (rotation.scaled_axis().map(f64::to_degrees).into(), [0, 1, 2].map(deviation))
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

    /// Returns true if the image is left as it is.
    pub fn is_negligible(&self, [width, height]: [usize; 2]) -> bool {
        let [right, bottom] = [width, height].map(|side| side as f64 - 1.0);
        [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].into_iter().all(|corner| {
            let [u, v] = self.at(corner);
            (u - corner[0]).hypot(v - corner[1]) < NEGLIGIBLE
        })
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
