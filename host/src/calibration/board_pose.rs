//! Where a board is.

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector3};

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

/// The homography from `places` to `directions`, by the direct linear transformation with normalised coordinates (Hartley, 1997).
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
