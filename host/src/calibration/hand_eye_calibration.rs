//! Calibration of the place of a camera on the tool of an arm, from pictures of a board that stands still.
//!
//! ```text
//! board in each picture = the homography of its corners, then least squares
//! start = the rotation that turns the axes of the camera's moves into those of the tool's (Park and Martin, 1994), and by it, the
//!         translation by linear least squares
//! outcome = all poses adjusted together: see `hand_eye_fit`
//! ```

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{
    board_detection::{BoardCorner, LEAST_CORNERS},
    camera_fit::{CameraFit, pose},
    hand_eye_fit::{HandEyeFit, Noise, View},
};
use crate::{
    images::Transform,
    lens::{CameraModel, HandEye},
};

/// The least number of pictures.
pub const LEAST_POSES: usize = 5;
/// A corner is dropped if its error in its picture is above this many pixels, and above this multiple of the mean.
const OUTLIER_PX: f64 = 0.5;
const OUTLIER: f64 = 5.0;
/// The least turn of the tool about a second axis, in degrees.
const LEAST_TURN_DEG: f64 = 5.0;
/// The largest errors of an arm whose poses are taken to belong to the pictures, in millimetres and degrees.
const LARGEST_ERROR: [f64; 2] = [5.0, 1.0];
/// The largest standard deviations of the outcome, in millimetres and degrees.
const LARGEST_DEVIATION: [f64; 2] = [3.0, 0.5];

/// A picture of the board, and the pose of the tool when it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmView {
    /// The name of the picture for messages.
    pub name: String,
    /// The pose of the tool in the frame of the arm's base, as the arm reported it.
    pub tool: Transform,
    /// The corners that the picture shows.
    pub corners: Vec<BoardCorner>,
}

/// The errors of an arm's poses: standard deviations along and about each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmNoise {
    /// In millimetres.
    pub translation_mm: f64,
    /// In degrees.
    pub rotation_deg: f64,
}

impl ArmNoise {
    /// The errors that arms of Universal Robots are sold with.
    pub const USUAL: ArmNoise = ArmNoise { translation_mm: 0.1, rotation_deg: 0.01 };
}

/// A camera's place on the tool.
#[derive(Clone, Debug)]
pub struct HandEyeCalibration {
    /// The camera on the tool, with its standard deviations.
    pub hand_eye: HandEye,
    /// The pose of the board in the frame of the arm's base.
    pub board: Transform,
    /// The errors of the arm's poses, as the pictures show them.
    pub noise: ArmNoise,
    /// The root of the mean squared distance between where corners are seen and where they should be, in pixels.
    pub rms_px: f64,
    /// The pictures.
    pub views: Vec<ArmViewErrors>,
}

/// The errors of a picture after the calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmViewErrors {
    /// The name of the picture.
    pub name: String,
    /// The number of corners that were used.
    pub corners: usize,
    /// The distance in millimetres between where the arm reported the tool and where the pictures put it.
    pub translation_mm: f64,
    /// The angle in degrees between the two.
    pub rotation_deg: f64,
    /// The root of the mean squared distance between where corners are seen and where they should be, in pixels.
    pub rms_px: f64,
}

/// The reason why pictures and poses do not determine the place of a camera on a tool.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HandEyeError {
    /// There are too few pictures.
    #[error(
        "{found} pictures with the board and a pose, at least {LEAST_POSES} are needed and 10 to 15 are better: look at the board \
         from all sides, with the tool turned by 20 to 40 degrees about each of its axes"
    )]
    TooFewPoses {
        /// The number of pictures with the board.
        found: usize,
    },
    /// No pose of the board explains the corners of a picture.
    #[error("no pose of the board explains its corners in {name}: check the lens and the squares of the board")]
    NoBoard {
        /// The name of the picture.
        name: String,
    },
    /// The tool was not turned, or about a single axis.
    #[error(
        "the tool was turned by {turn_deg:.1} degrees about a second axis, which does not show where the camera sits: turn it by 20 to \
         40 degrees about at least two of its axes"
    )]
    FewTurns {
        /// The largest turn about a second axis.
        turn_deg: f64,
    },
    /// The poses do not belong to the pictures.
    #[error(
        "poses and pictures contradict each other: the arm would be off by {translation_mm:.1} mm and {rotation_deg:.2} degrees, and most \
         in {worst}: check that each pose belongs to its picture and is that of the tool in the base, the units of the poses, the \
         squares of the board, and that board and base stood still"
    )]
    Contradiction {
        /// The standard deviation of the arm's translations that would explain the pictures.
        translation_mm: f64,
        /// That of its rotations.
        rotation_deg: f64,
        /// The picture with the largest error.
        worst: String,
    },
    /// The outcome is too uncertain to be of use.
    #[error(
        "the pictures tell the camera's place to {translation_mm:.1} mm and {rotation_deg:.2} degrees only: take more, with the tool turned \
         by 20 to 40 degrees about each of its axes, and the board filling most of the picture"
    )]
    Uncertain {
        /// The largest standard deviation of the translation.
        translation_mm: f64,
        /// That of the rotation.
        rotation_deg: f64,
    },
}

impl HandEyeCalibration {
    /// Calibrates from pictures that `camera` took of one board, whose arm errs about as `stated`: the pictures show by how much.
    ///
    /// # Errors
    /// [`HandEyeError`] if the pictures do not determine the place of the camera.
    pub fn estimate(views: &[ArmView], camera: &CameraModel, stated: ArmNoise) -> Result<HandEyeCalibration, HandEyeError> {
        if views.len() < LEAST_POSES {
            return Err(HandEyeError::TooFewPoses { found: views.len() });
        }
        let seen: Vec<(Isometry3<f64>, Vec<BoardCorner>)> = views
            .iter()
            .map(|view| board_in_view(&view.corners, camera).ok_or_else(|| HandEyeError::NoBoard { name: view.name.clone() }))
            .collect::<Result<_, _>>()?;
        let tools: Vec<Isometry3<f64>> = views.iter().map(|view| view.tool.isometry()).collect();
        let boards: Vec<Isometry3<f64>> = seen.iter().map(|(board, _)| *board).collect();
        let first = first_pose(&tools, &boards)?;
        let reported: Vec<View> = tools.iter().zip(&seen).map(|(&tool, (_, corners))| View { tool, corners }).collect();
        // With the tool where the pictures put it, every corner is in front of the camera.
        let board = tools[0] * first * boards[0];
        let tools = boards.iter().map(|seen| board * (first * seen).inverse()).collect();
        let start = HandEyeFit { camera: first, board, tools };
        let stated = Noise { corners_px: 0.1, translation_mm: stated.translation_mm, rotation: stated.rotation_deg.to_radians() };
        let undetermined = HandEyeError::Uncertain { translation_mm: f64::INFINITY, rotation_deg: f64::INFINITY };
        let (fit, noise, covariance) = start.adjusted(&reported, camera, stated).ok_or(undetermined)?;
        let errors = views.iter().zip(&reported).enumerate().map(|(index, (view, reported))| {
            let off = fit.off(index, reported);
            let squares = fit.residuals(index, reported, camera).unwrap_or_default();
            let mean = squares.iter().map(|residual| residual.norm_squared()).sum::<f64>() / squares.len().max(1) as f64;
            ArmViewErrors {
                name: view.name.clone(),
                corners: reported.corners.len(),
                translation_mm: off.fixed_rows::<3>(3).norm(),
                rotation_deg: off.fixed_rows::<3>(0).norm().to_degrees(),
                rms_px: mean.sqrt(),
            }
        });
        let errors: Vec<ArmViewErrors> = errors.collect();
        let found = ArmNoise { translation_mm: noise.translation_mm, rotation_deg: noise.rotation.to_degrees() };
        if found.translation_mm > LARGEST_ERROR[0] || found.rotation_deg > LARGEST_ERROR[1] {
            let size =
                |view: &&ArmViewErrors| (view.translation_mm / LARGEST_ERROR[0]).hypot(view.rotation_deg / LARGEST_ERROR[1]);
            let worst = errors.iter().max_by(|a, b| size(a).total_cmp(&size(b))).map(|view| view.name.clone());
            let ArmNoise { translation_mm, rotation_deg } = found;
            return Err(HandEyeError::Contradiction { translation_mm, rotation_deg, worst: worst.unwrap_or_default() });
        }
        // Turns come first there, in radians.
        let unit = |k: usize| if k < 3 { 1.0 } else { 180.0 / std::f64::consts::PI };
        let at = |k: usize| (k + 3) % 6;
        let covariance = [0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|j| unit(i) * unit(j) * covariance[(at(i), at(j))]));
        let deviations = |first: usize| [0, 1, 2].map(|axis| covariance[first + axis][first + axis].sqrt());
        let [translation_mm, rotation_deg] = [0, 3].map(|first| deviations(first).into_iter().fold(0.0, f64::max));
        if !(translation_mm <= LARGEST_DEVIATION[0] && rotation_deg <= LARGEST_DEVIATION[1]) {
            return Err(HandEyeError::Uncertain { translation_mm, rotation_deg });
        }
        let Transform { translation_mm, rotation_deg } = fit.camera.into();
        let hand_eye = HandEye {
            translation_mm,
            rotation_deg,
            translation_deviation_mm: Some(deviations(0)),
            rotation_deviation_deg: Some(deviations(3)),
            covariance: Some(covariance),
        };
        let (squares, count) = errors
            .iter()
            .fold((0.0, 0), |(squares, count), view| (squares + view.rms_px.powi(2) * view.corners as f64, count + view.corners));
        let rms_px = (squares / count as f64).sqrt();
        Ok(HandEyeCalibration { hand_eye, board: fit.board.into(), noise: found, rms_px, views: errors })
    }
}

/// The board in the frame of the camera, and the corners that agree with it.
fn board_in_view(corners: &[BoardCorner], camera: &CameraModel) -> Option<(Isometry3<f64>, Vec<BoardCorner>)> {
    let places: Vec<[f64; 2]> = corners.iter().map(|corner| corner.board_mm).collect();
    let directions: Vec<[f64; 2]> = corners.iter().map(|corner| camera.direction(corner.pixel)).collect::<Option<_>>()?;
    let fit = CameraFit { camera: *camera, poses: vec![pose(&places, &directions)?] };
    let adjusted = |fit: CameraFit, corners: &Vec<BoardCorner>| fit.descended(std::slice::from_ref(corners), &|_| false);
    let all = corners.to_vec();
    let fit = adjusted(fit, &all);
    let errors: Vec<f64> = fit.residuals(0, &all)?.iter().map(|[u, v]| u.hypot(*v)).collect();
    let limit = (OUTLIER * errors.iter().sum::<f64>() / errors.len() as f64).max(OUTLIER_PX);
    let kept: Vec<BoardCorner> =
        all.iter().zip(&errors).filter(|(_, error)| **error <= limit).map(|(corner, _)| *corner).collect();
    if kept.len() < LEAST_CORNERS {
        return None;
    }
    let fit = if kept.len() < all.len() { adjusted(fit, &kept) } else { fit };
    Some((fit.poses[0], kept))
}

/// The first pose of the camera on the tool, by the moves between all pairs of pictures: those of the tool are
/// `camera * (move of the camera) * camera^-1`.
fn first_pose(tools: &[Isometry3<f64>], boards: &[Isometry3<f64>]) -> Result<Isometry3<f64>, HandEyeError> {
    let pairs = (0..tools.len()).flat_map(|i| (i + 1..tools.len()).map(move |j| (i, j)));
    let moves = pairs.map(|(i, j)| (tools[j].inverse() * tools[i], boards[j] * boards[i].inverse()));
    let moves: Vec<(Isometry3<f64>, Isometry3<f64>)> = moves.collect();
    // The rotation that turns the axes of the camera's moves into those of the tool's (Kabsch's solution).
    let correlation: Matrix3<f64> =
        moves.iter().map(|(tool, camera)| camera.rotation.scaled_axis() * tool.rotation.scaled_axis().transpose()).sum();
    let svd = correlation.svd(true, true);
    let turn_deg = (svd.singular_values[1] / moves.len() as f64).sqrt().to_degrees();
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(HandEyeError::FewTurns { turn_deg }) };
    if turn_deg.is_nan() || turn_deg < LEAST_TURN_DEG {
        return Err(HandEyeError::FewTurns { turn_deg });
    }
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(v_t.transpose() * handed * u.transpose());
    // (R - 1) t = rotation * (move of the camera) - (move of the tool)
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (tool, camera) in &moves {
        let by_translation = tool.rotation.to_rotation_matrix().matrix() - Matrix3::identity();
        matrix += by_translation.transpose() * by_translation;
        right += by_translation.transpose() * (rotation * camera.translation.vector - tool.translation.vector);
    }
    let translation = matrix.cholesky().ok_or(HandEyeError::FewTurns { turn_deg })?.solve(&right);
    Ok(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_rotation_matrix(&rotation)))
}

#[cfg(test)]
mod tests {
    use fastrand::Rng;
    use nalgebra::Point3;
    use rayon::prelude::*;

    use super::*;
    use crate::lens::{Lens, LensModel};

    /// The board's corners: 6x5, 40 mm apart.
    const SQUARE_MM: f64 = 40.0;
    const CORNERS: [usize; 2] = [6, 5];
    const CORNER_NOISE_PX: f64 = 0.1;

    fn normal(random: &mut Rng) -> f64 {
        (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
    }

    fn vector(mut value: impl FnMut() -> f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| value())
    }

    fn camera() -> CameraModel {
        let lens = Lens::new(LensModel::PlumbBob, &[-0.2, 0.05, 0.001, -0.0005, 0.0]).unwrap();
        CameraModel { size: Some([1280, 960]), focal_px: [1200.0, 1203.0], principal_point: [641.0, 476.5], lens }
    }

    /// The true pose of a camera on the tool of an arm, and what the camera saw of a board when the arm, which errs by `noise`,
    /// reported these poses: from all sides, turned by up to 30 degrees about each axis.
    fn made_up(seed: u64, count: usize, noise: ArmNoise) -> (Isometry3<f64>, Vec<ArmView>) {
        let mut random = Rng::with_seed(seed);
        let mut within = |most: f64| most * (2.0 * random.f64() - 1.0);
        let on_tool = Isometry3::new(vector(|| within(80.0)), vector(|| within(1.5)));
        let board = Isometry3::new(Vector3::new(500.0, within(200.0), within(100.0)), vector(|| within(0.5)));
        let middle = Vector3::new(100.0, 80.0, 0.0);
        let poses: Vec<Isometry3<f64>> = (0..count)
            .map(|_| {
                let turn = UnitQuaternion::new(vector(|| within(0.5)));
                let seen_at = Vector3::new(within(40.0), within(30.0), 420.0 + within(80.0));
                Isometry3::from_parts(Translation3::from(seen_at - turn * middle), turn)
            })
            .collect();
        let camera = camera();
        let ([k1, k2, p1, p2, _], [fx, fy], [cx, cy]) =
            ([-0.2, 0.05, 0.001, -0.0005, 0.0], camera.focal_px, camera.principal_point);
        let views = poses.into_iter().enumerate().map(|(index, pose)| {
            let places =
                (0..CORNERS[1]).flat_map(|row| (0..CORNERS[0]).map(move |column| [column, row].map(|k| SQUARE_MM * k as f64)));
            let corner = |board_mm: [f64; 2]| {
                let point = pose * Point3::new(board_mm[0], board_mm[1], 0.0);
                let (x, y) = (point.x / point.z, point.y / point.z);
                // The formula of OpenCV's documentation.
                let r2 = x * x + y * y;
                let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
                let u = fx * (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + cx;
                let v = fy * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + cy;
                BoardCorner { board_mm, pixel: [u, v].map(|at| at + CORNER_NOISE_PX * normal(&mut random)) }
            };
            let corners = places.map(corner).collect();
            let tool = board * (on_tool * pose).inverse();
            let turn = UnitQuaternion::new(vector(|| noise.rotation_deg.to_radians() * normal(&mut random)));
            let moved = tool.translation.vector + vector(|| noise.translation_mm * normal(&mut random));
            let reported = Isometry3::from_parts(Translation3::from(moved), turn * tool.rotation);
            ArmView { name: format!("{index}.png"), tool: reported.into(), corners }
        });
        (on_tool, views.collect())
    }

    /// The distance of a calibration from the truth: in millimetres, and about the tool's axes in degrees.
    fn errors(found: &HandEye, truth: &Isometry3<f64>) -> [Vector3<f64>; 2] {
        let found = found.camera_in_tool().isometry();
        let turn = (found.rotation * truth.rotation.inverse()).scaled_axis();
        [found.translation.vector - truth.translation.vector, turn.map(f64::to_degrees)]
    }

    #[test]
    fn an_arm_that_errs_gives_the_place_and_honest_deviations() {
        // A run takes a quarter of a second without optimisation.
        let (count, least, most) = if cfg!(debug_assertions) { (12, 0.8, 1.0) } else { (200, 0.93, 0.975) };
        let run = |seed: u64| {
            let (truth, views) = made_up(seed, 15, ArmNoise { translation_mm: 0.1, rotation_deg: 0.01 });
            let found = HandEyeCalibration::estimate(&views, &camera(), ArmNoise::USUAL).unwrap();
            let errors = errors(&found.hand_eye, &truth);
            let deviations = [found.hand_eye.translation_deviation_mm, found.hand_eye.rotation_deviation_deg]
                .map(|of| Vector3::from(of.unwrap()));
            let held = [0, 1].map(|k| (0..3).filter(|axis| errors[k][*axis].abs() <= 2.0 * deviations[k][*axis]).count());
            (errors.map(|error| error.norm()), held, found.noise)
        };
        let runs: Vec<_> = (0..count).into_par_iter().map(run).collect();
        let [mm, deg] = [0, 1].map(|k| runs.iter().map(|(errors, ..)| errors[k]).fold(0.0, f64::max));
        assert!(mm < 0.5 && deg < 0.05, "at most {mm} mm and {deg} degrees off");
        let [held_mm, held_deg] =
            [0, 1].map(|k| runs.iter().map(|(_, held, _)| held[k]).sum::<usize>() as f64 / (3.0 * count as f64));
        assert!(
            (least..=most).contains(&held_mm) && (least..=most).contains(&held_deg),
            "{held_mm} and {held_deg} within two deviations"
        );
        let noise = runs.iter().map(|(.., noise)| noise.translation_mm).sum::<f64>() / count as f64;
        assert!((noise - 0.1).abs() < 0.02, "an arm that errs by {noise} mm");
    }

    #[test]
    fn an_arm_that_errs_more_than_stated_is_found_out() {
        let (_, views) = made_up(8, 15, ArmNoise { translation_mm: 1.0, rotation_deg: 0.1 });
        let ArmNoise { translation_mm, rotation_deg } =
            HandEyeCalibration::estimate(&views, &camera(), ArmNoise::USUAL).unwrap().noise;
        assert!((0.6..1.4).contains(&translation_mm) && (0.05..0.15).contains(&rotation_deg), "{translation_mm} {rotation_deg}");
    }

    #[test]
    fn pictures_that_do_not_tell_are_refused() {
        let arm = ArmNoise::USUAL;
        let estimate = |views: &[ArmView]| HandEyeCalibration::estimate(views, &camera(), arm).unwrap_err();
        let (_, views) = made_up(1, 10, arm);
        assert_eq!(estimate(&views[..4]), HandEyeError::TooFewPoses { found: 4 });
        // Poses in metres.
        let in_metres = |view: &ArmView| {
            let translation_mm = view.tool.translation_mm.map(|mm| mm / 1000.0);
            ArmView { tool: Transform { translation_mm, ..view.tool }, ..view.clone() }
        };
        let contradiction = estimate(&views.iter().map(in_metres).collect::<Vec<_>>());
        assert!(matches!(contradiction, HandEyeError::Contradiction { .. }), "{contradiction}");
        // One of the poses is that of another picture.
        let mut swapped = views.clone();
        swapped[3].tool = Transform { translation_mm: [500.0, 100.0, 700.0], ..views[3].tool };
        let HandEyeError::Contradiction { worst, .. } = estimate(&swapped) else { panic!("{}", estimate(&swapped)) };
        assert_eq!(worst, "3.png");
        // A stage moves the camera without turning it.
        let straight: Vec<ArmView> = views
            .iter()
            .map(|view| ArmView { tool: Transform { rotation_deg: [0.0; 3], ..view.tool }, ..view.clone() })
            .collect();
        let few = estimate(&straight);
        assert!(matches!(few, HandEyeError::FewTurns { turn_deg } if turn_deg < 1.0), "{few}");
    }
}
