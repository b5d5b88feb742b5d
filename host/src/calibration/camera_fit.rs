//! The camera and the poses of the board that explain the corners best.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix2x3, Matrix3, Matrix6, Point3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector2,
    Vector3, Vector6,
};

use super::board_detection::BoardCorner;
use crate::lens::{CameraModel, Lens, LensModel};

/// The corners of the board that an image shows.
pub type Corners = Vec<BoardCorner>;

/// The focal lengths that are tried first, as multiples of the longer side of the image.
const FIRST_FOCAL: [f64; 2] = [0.25, 12.0];
/// The number of focal lengths that are tried, and the share of the most distant ones.
const TRIALS: i32 = 60;
const MAX_ITERATIONS: usize = 100;
/// The number of parameters before the coefficients of the lens: `fx fy cx cy`.
const COEFFICIENTS: usize = 4;
/// The step of numeric derivatives by coefficients and by directions.
const STEP: f64 = 1e-5;
/// The weight of a coefficient's square in the cost, in squared pixels. Coefficients are of the order of 1, and those that the
/// corners do not tell apart, as in the rational model, stay small instead of cancelling each other. It equals a deviation of 1
/// with corners that are off by a tenth of a pixel.
const PRIOR: f64 = 0.01;

/// A camera, and the pose of the board in each image: from the board's coordinates in millimetres to the camera's.
#[derive(Clone, Debug)]
pub struct CameraFit {
    pub camera: CameraModel,
    pub poses: Vec<Isometry3<f64>>,
}

/// A corner's reprojection: its error, and that error's derivatives.
struct Row {
    residual: Vector2<f64>,
    by_camera: DMatrix<f64>,
    by_pose: SMatrix<f64, 2, 6>,
}

/// The normal equations: of the camera's parameters, and for each image those of its pose and the part they share.
struct Normal {
    camera: DMatrix<f64>,
    right: DVector<f64>,
    images: Vec<(Matrix6<f64>, DMatrix<f64>, Vector6<f64>)>,
}

impl CameraFit {
    /// The first camera: without distortion, with the principal point in the middle of the image, and of all focal lengths the
    /// one that explains the corners best with the poses that homographies give (Zhang, 2000). `None` if no camera sees the
    /// board in all images.
    pub fn first(images: &[Corners], size: [usize; 2], model: LensModel) -> Option<CameraFit> {
        let coefficients = vec![0.0; model.coefficient_names().len()];
        let lens = Lens::new(model, &coefficients).ok()?;
        let principal_point = size.map(|side| (side as f64 - 1.0) / 2.0);
        let longer = size[0].max(size[1]) as f64;
        let attempt = |trial: i32| {
            let focal =
                longer * FIRST_FOCAL[0] * (FIRST_FOCAL[1] / FIRST_FOCAL[0]).powf(f64::from(trial) / f64::from(TRIALS - 1));
            let camera = CameraModel { size: Some(size), focal_px: [focal; 2], principal_point, lens };
            let pose = |corners: &Corners| {
                let places: Vec<[f64; 2]> = corners.iter().map(|corner| corner.board_mm).collect();
                let directions: Option<Vec<[f64; 2]>> = corners.iter().map(|corner| camera.direction(corner.pixel)).collect();
                pose(&places, &directions?)
            };
            let fit = CameraFit { camera, poses: images.iter().map(pose).collect::<Option<_>>()? };
            Some((fit.cost(images)?, fit))
        };
        (0..TRIALS).filter_map(attempt).min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, fit)| fit)
    }

    /// Adjusts all parameters by the method of Levenberg and Marquardt: at first without those that need a good start.
    pub fn adjusted(self, images: &[Corners]) -> CameraFit {
        // The principal point and higher orders follow the noise while the focal length is far off.
        let first_order = [0, 1, COEFFICIENTS];
        self.descended(images, &|parameter| first_order.contains(&parameter)).descended(images, &|_| true)
    }

    /// Adjusts the poses and the parameters of the camera that are `free`.
    pub fn descended(mut self, images: &[Corners], free: &dyn Fn(usize) -> bool) -> CameraFit {
        let Some(mut cost) = self.cost(images) else { return self };
        let mut damping = 1e-3;
        for _ in 0..MAX_ITERATIONS {
            let Some(normal) = self.normal(images, free) else { break };
            let moved = normal.step(damping).and_then(|(camera, poses)| self.moved(&camera, &poses));
            let better = moved.and_then(|moved| Some((moved.cost(images).filter(|moved| *moved < cost)?, moved)));
            match better {
                Some((lower, moved)) => {
                    let is_done = cost - lower < 1e-9 * cost;
                    (self, cost, damping) = (moved, lower, (damping / 10.0).max(1e-12));
                    if is_done {
                        break;
                    }
                }
                None if damping > 1e8 => break,
                None => damping *= 10.0,
            }
        }
        self
    }

    /// Returns the pixel at which a corner should be seen. `None` behind the camera and beyond the lens model.
    pub fn pixel(&self, image: usize, place: [f64; 2]) -> Option<[f64; 2]> {
        let point = self.poses[image] * Point3::new(place[0], place[1], 0.0);
        if point.z > 0.0 { self.camera.pixel([point.x / point.z, point.y / point.z]) } else { None }
    }

    /// From where each corner of an image should be seen to where it is, in pixels.
    pub fn residuals(&self, image: usize, corners: &[BoardCorner]) -> Option<Vec<[f64; 2]>> {
        let residual = |corner: &BoardCorner| {
            let [u, v] = self.pixel(image, corner.board_mm)?;
            Some([corner.pixel[0] - u, corner.pixel[1] - v])
        };
        corners.iter().map(residual).collect()
    }

    fn cost(&self, images: &[Corners]) -> Option<f64> {
        let of_image = |(image, corners): (usize, &Corners)| {
            Some(self.residuals(image, corners)?.iter().map(|[u, v]| u * u + v * v).sum::<f64>())
        };
        let prior: f64 = self.camera.lens.coefficients().iter().map(|coefficient| PRIOR * coefficient * coefficient).sum();
        Some(images.iter().enumerate().map(of_image).sum::<Option<f64>>()? + prior)
    }

    /// The covariance of the camera's parameters `fx fy cx cy` and the coefficients, for corners with an error of one pixel on
    /// each axis. `None` if they are not determined.
    pub fn covariance(&self, images: &[Corners]) -> Option<DMatrix<f64>> {
        let (matrix, _) = self.normal(images, &|_| true)?.reduced(0.0)?;
        // Coefficients and focal lengths have scales too different for a plain inverse.
        let scale = matrix.map_diagonal(|d| 1.0 / d.sqrt());
        let scale = DMatrix::from_diagonal(&scale);
        let inverse = (&scale * matrix * &scale).cholesky()?.inverse();
        Some(&scale * inverse * &scale).filter(|covariance| covariance.diagonal().iter().all(|variance| variance.is_finite()))
    }

    fn parameters(&self) -> Vec<f64> {
        let CameraModel { focal_px: [fx, fy], principal_point: [cx, cy], lens, .. } = self.camera;
        [&[fx, fy, cx, cy], lens.coefficients()].concat()
    }

    fn moved(&self, camera_step: &DVector<f64>, pose_steps: &[Vector6<f64>]) -> Option<CameraFit> {
        let moved: Vec<f64> =
            self.parameters().iter().zip(camera_step.iter()).map(|(parameter, step)| parameter + step).collect();
        let (pinhole, coefficients) = moved.split_at(COEFFICIENTS);
        let lens = Lens::new(self.camera.lens.model(), coefficients).ok()?;
        let (focal_px, principal_point) = ([pinhole[0], pinhole[1]], [pinhole[2], pinhole[3]]);
        let camera = CameraModel { focal_px, principal_point, lens, ..self.camera };
        let pose = |(pose, step): (&Isometry3<f64>, &Vector6<f64>)| {
            let rotation = UnitQuaternion::new(step.fixed_rows::<3>(0).into_owned()) * pose.rotation;
            let translation = pose.translation.vector + step.fixed_rows::<3>(3);
            Isometry3::from_parts(Translation3::from(translation), rotation)
        };
        let poses = self.poses.iter().zip(pose_steps).map(pose).collect();
        (focal_px[0] > 0.0 && focal_px[1] > 0.0).then_some(CameraFit { camera, poses })
    }

    fn normal(&self, images: &[Corners], free: &dyn Fn(usize) -> bool) -> Option<Normal> {
        let count = self.parameters().len();
        let lenses = self.varied_lenses()?;
        let coefficients = self.camera.lens.coefficients();
        let mut normal = Normal { camera: DMatrix::zeros(count, count), right: DVector::zeros(count), images: Vec::new() };
        for (image, corners) in images.iter().enumerate() {
            let (mut own, mut shared, mut right) = (Matrix6::zeros(), DMatrix::zeros(count, 6), Vector6::zeros());
            for corner in corners {
                let Row { residual, mut by_camera, by_pose } = self.row(image, corner, &lenses)?;
                (0..count).filter(|&parameter| !free(parameter)).for_each(|parameter| by_camera.column_mut(parameter).fill(0.0));
                normal.camera += by_camera.transpose() * &by_camera;
                normal.right += by_camera.transpose() * residual;
                own += by_pose.transpose() * by_pose;
                shared += by_camera.transpose() * by_pose;
                right += by_pose.transpose() * residual;
            }
            normal.images.push((own, shared, right));
        }
        for parameter in 0..count {
            if !free(parameter) {
                normal.camera[(parameter, parameter)] = 1.0;
            } else if let Some(coefficient) = parameter.checked_sub(COEFFICIENTS).map(|index| coefficients[index]) {
                normal.camera[(parameter, parameter)] += PRIOR;
                normal.right[parameter] -= PRIOR * coefficient;
            }
        }
        Some(normal)
    }

    /// The lens with each coefficient a step ahead and a step behind.
    fn varied_lenses(&self) -> Option<Vec<[Lens; 2]>> {
        let coefficients = self.camera.lens.coefficients();
        let varied = |index: usize, step: f64| {
            let mut coefficients = coefficients.to_vec();
            coefficients[index] += step;
            Lens::new(self.camera.lens.model(), &coefficients).ok()
        };
        (0..coefficients.len()).map(|index| Some([varied(index, STEP)?, varied(index, -STEP)?])).collect()
    }

    fn row(&self, image: usize, corner: &BoardCorner, lenses: &[[Lens; 2]]) -> Option<Row> {
        let pose = &self.poses[image];
        let turned = pose.rotation * Vector3::new(corner.board_mm[0], corner.board_mm[1], 0.0);
        let point = turned + pose.translation.vector;
        let direction = [point.x / point.z, point.y / point.z];
        let distorted = self.camera.lens.distort(direction)?;
        let (pixel, by_point) = projection(&self.camera, &point)?;
        let mut by_camera = DMatrix::zeros(2, COEFFICIENTS + lenses.len());
        by_camera[(0, 0)] = distorted[0];
        by_camera[(1, 1)] = distorted[1];
        by_camera[(0, 2)] = 1.0;
        by_camera[(1, 3)] = 1.0;
        for (index, [ahead, behind]) in lenses.iter().enumerate() {
            let slope = slope(&self.camera, distorted, [ahead.distort(direction), behind.distort(direction)]);
            by_camera.column_mut(COEFFICIENTS + index).copy_from(&slope);
        }
        let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
        // A small rotation `w` moves the point by `w x turned`.
        by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_point * -turned.cross_matrix()));
        by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&(by_point * Matrix3::identity()));
        Some(Row { residual: Vector2::from(corner.pixel) - pixel, by_camera, by_pose })
    }
}

impl Normal {
    /// The equations of the camera's parameters alone (Schur complement).
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (mut matrix, mut right) = (damped(self.camera.clone(), damping), self.right.clone());
        for (own, shared, own_right) in &self.images {
            let inverse = damped(*own, damping).cholesky()?.inverse();
            matrix -= shared * inverse * shared.transpose();
            right -= shared * inverse * own_right;
        }
        Some((matrix, right))
    }

    /// The steps of the camera's parameters and of each pose.
    fn step(&self, damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let (matrix, right) = self.reduced(damping)?;
        let camera = matrix.cholesky()?.solve(&right);
        let pose = |(own, shared, own_right): &(Matrix6<f64>, DMatrix<f64>, Vector6<f64>)| {
            let right: DVector<f64> = DVector::from_column_slice(own_right.as_slice()) - shared.transpose() * &camera;
            Some(damped(*own, damping).cholesky()?.solve(&Vector6::from_column_slice(right.as_slice())))
        };
        let poses = self.images.iter().map(pose).collect::<Option<_>>()?;
        Some((camera, poses))
    }
}

/// The pixel at which a camera sees a point before it, and the derivatives by the point. `None` beyond the lens model.
pub fn projection(camera: &CameraModel, point: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    let [x, y] = [point.x / point.z, point.y / point.z];
    let distorted = camera.lens.distort([x, y])?;
    let varied = |x: f64, y: f64| camera.lens.distort([x, y]);
    let by_x = slope(camera, distorted, [varied(x + STEP, y), varied(x - STEP, y)]);
    let by_y = slope(camera, distorted, [varied(x, y + STEP), varied(x, y - STEP)]);
    let by_direction = nalgebra::Matrix2::from_columns(&[by_x, by_y]);
    let by_point = by_direction * Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) / point.z;
    let pixel = camera.pixel([x, y]).filter(|_| point.z > 0.0)?;
    Some((pixel.into(), by_point))
}

/// The slope of a pixel, by what the lens makes of a step ahead and a step behind. Beside the end of its model, one of the two may
/// have no value, and what it makes of no step counts.
fn slope(camera: &CameraModel, distorted: [f64; 2], [ahead, behind]: [Option<[f64; 2]>; 2]) -> Vector2<f64> {
    let steps = f64::from(u8::from(ahead.is_some()) + u8::from(behind.is_some())).max(1.0);
    let (ahead, behind, [fx, fy]) = (ahead.unwrap_or(distorted), behind.unwrap_or(distorted), camera.focal_px);
    Vector2::new(fx * (ahead[0] - behind[0]), fy * (ahead[1] - behind[1])) / (steps * STEP)
}

/// A matrix with a larger diagonal (Marquardt, 1963).
fn damped<R: nalgebra::Dim, S: nalgebra::RawStorageMut<f64, R, R>>(
    mut matrix: nalgebra::Matrix<f64, R, R, S>,
    damping: f64,
) -> nalgebra::Matrix<f64, R, R, S> {
    for k in 0..matrix.nrows() {
        matrix[(k, k)] *= 1.0 + damping;
    }
    matrix
}

/// The least second smallest eigenvalue of equations that determine a homography, as a share of the largest.
const MIN_SECOND: f64 = 1e-9;

/// The pose of a plane whose points at `places` are seen in `directions`, `(x, y, 1)` from the camera: by their homography
/// (Zhang, 2000). `None` if they are in a row, or the plane is behind the camera.
pub fn pose(places: &[[f64; 2]], directions: &[[f64; 2]]) -> Option<Isometry3<f64>> {
    let h = homography(places, directions)?;
    let [first, second, third] = [0, 1, 2].map(|column| h.column(column).into_owned());
    let length = (first.norm() + second.norm()) / 2.0;
    let sign = third.z.signum();
    let [first, second, translation] = [first, second, third].map(|column: Vector3<f64>| column * (sign / length));
    let svd = Matrix3::from_columns(&[first, second, first.cross(&second)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let is_usable = translation.z > 0.0 && rotation.determinant() > 0.0 && translation.iter().all(|t| t.is_finite());
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    is_usable.then(|| Isometry3::from_parts(Translation3::from(translation), rotation))
}

/// The homography from `places` to `directions`, by the direct linear transformation with normalised coordinates (Hartley,
/// 1997).
fn homography(places: &[[f64; 2]], directions: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let (from, to) = (normalization(places)?, normalization(directions)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (place, direction) in places.iter().zip(directions) {
        let [p, q] = [from * Vector3::new(place[0], place[1], 1.0), to * Vector3::new(direction[0], direction[1], 1.0)];
        for (axis, at) in [(0, q.x), (1, q.y)] {
            let mut row = SMatrix::<f64, 1, 9>::zeros();
            for k in 0..3 {
                row[3 * axis + k] = p[k];
                row[6 + k] = -at * p[k];
            }
            normal += row.transpose() * row;
        }
    }
    let eigen = normal.symmetric_eigen();
    // Points in a row leave several homographies.
    let [_, second, .., largest] = *sorted(eigen.eigenvalues.as_slice()) else { return None };
    if second < MIN_SECOND * largest {
        return None;
    }
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    Some(to.try_inverse()? * Matrix3::from_row_slice(h.as_slice()) * from)
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Moves the mean of points to 0 and their mean distance from it to the root of 2.
fn normalization(points: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let count = points.len() as f64;
    let mean = [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count);
    let distance = points.iter().map(|[x, y]| (x - mean[0]).hypot(y - mean[1])).sum::<f64>() / count;
    let scale = 2.0_f64.sqrt() / distance;
    scale.is_finite().then(|| Matrix3::new(scale, 0.0, -scale * mean[0], 0.0, scale, -scale * mean[1], 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_found_from_exact_directions() {
        let places: Vec<[f64; 2]> =
            (0..6).flat_map(|row| (0..9).map(move |column| [20.0 * f64::from(column), 20.0 * f64::from(row)])).collect();
        for turn in [Vector3::zeros(), Vector3::new(0.5, -0.3, 1.2), Vector3::new(-0.4, 0.6, 3.0)] {
            let truth = Isometry3::new(Vector3::new(-40.0, 30.0, 500.0), turn);
            let direction = |&[x, y]: &[f64; 2]| {
                let point = truth * nalgebra::Point3::new(x, y, 0.0);
                [point.x / point.z, point.y / point.z]
            };
            let directions: Vec<[f64; 2]> = places.iter().map(direction).collect();
            let found = pose(&places, &directions).unwrap();
            assert!((found.translation.vector - truth.translation.vector).norm() < 1e-6, "{found} instead of {truth}");
            assert!(found.rotation.angle_to(&truth.rotation) < 1e-8);
        }
        assert_eq!(pose(&places[..9], &places[..9]), None, "corners in a row");
    }
}
