//! The hand-eye calibration's least squares: the poses of the camera on the tool and of the board in the frame of the base, together
//! with the errors of the arm's poses, that explain the corners best.
//!
//! ```text
//! unknowns: the camera on the tool, the board in the base, and the true pose of the tool in each picture
//! noise: of the corners, of the arm's translations and of its rotations; the last two start at what is stated of the arm
//! repeat until the noise settles:
//!     adjust all unknowns to the corners and to the arm's poses, each weighed by its noise (Levenberg and Marquardt)
//!     estimate the noise anew, with what the adjustment leaves uncertain (expectation and maximisation)
//! ```
//!
//! With the arm's poses adjusted, too, an arm that errs by more than the corners do does not pass for one that is exact, and
//! the standard deviations of the outcome hold. The poses of tool and picture are eliminated from the equations (Schur complement).

use nalgebra::{
    Isometry3, Matrix2x3, Matrix6, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3, Vector6,
};

use super::{board_detection::BoardCorner, camera_fit::projection};
use crate::lens::CameraModel;

/// The most adjustments, and the most steps of one.
const MAX_ROUNDS: usize = 10;
const MAX_ITERATIONS: usize = 50;
/// The most estimates of the noise between two adjustments.
const MAX_ESTIMATES: usize = 200;
/// The change of a noise, relative to it, from which on it has not settled.
const SETTLED: f64 = 1e-3;
/// The weight of what is stated of the arm beside the poses, in pictures.
const STATED_WEIGHT: f64 = 1.0;
/// The parameters that all pictures share: of the camera on the tool and of the board, each of three for the rotation and three
/// for the translation.
const SHARED: usize = 12;

/// The corners that one picture shows, and the pose that the arm reported for it, from the tool to the base in millimetres.
#[derive(Clone, Debug)]
pub struct View<'a> {
    pub tool: Isometry3<f64>,
    pub corners: &'a [BoardCorner],
}

/// Standard deviations on each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    pub corners_px: f64,
    pub translation_mm: f64,
    /// In radians.
    pub rotation: f64,
}

/// The poses that explain the corners.
#[derive(Clone, Debug)]
pub struct HandEyeFit {
    /// From the camera to the tool.
    pub camera: Isometry3<f64>,
    /// From the board to the base.
    pub board: Isometry3<f64>,
    /// From the tool to the base, in each picture.
    pub tools: Vec<Isometry3<f64>>,
}

/// The equations of one picture, in units of pixels.
struct Block {
    shared: SMatrix<f64, SHARED, SHARED>,
    own: Matrix6<f64>,
    coupling: SMatrix<f64, SHARED, 6>,
    shared_right: SVector<f64, SHARED>,
    own_right: Vector6<f64>,
    /// The distance of the tool from where the arm reported it: a turn in radians and a translation, along the axes of the base.
    off: Vector6<f64>,
}

/// A solution of the equations.
struct Step {
    shared: SVector<f64, SHARED>,
    tools: Vec<Vector6<f64>>,
    /// The covariances of the shared parameters and of each pose of the tool.
    covariance: SMatrix<f64, SHARED, SHARED>,
    covariances: Vec<Matrix6<f64>>,
}

impl HandEyeFit {
    /// Adjusts the poses and the noise, which starts at what is stated of the arm. Also returns the covariance of the camera on
    /// the tool: of a turn about the tool's axes in radians, and of the translation in millimetres. `None` if the pictures do not
    /// determine them.
    pub fn adjusted(mut self, views: &[View], camera: &CameraModel, stated: Noise) -> Option<(HandEyeFit, Noise, Matrix6<f64>)> {
        let mut noise = stated;
        for _ in 0..MAX_ROUNDS {
            self = self.descended(views, camera, noise)?;
            noise.corners_px = self.corner_noise(views, camera)?;
            let blocks = self.blocks(views, camera)?;
            let before = noise;
            for _ in 0..MAX_ESTIMATES {
                let step = solve(&blocks, noise, 0.0)?;
                let next = estimated(&blocks, &step, noise, stated);
                let has_settled = is_near(next, noise, SETTLED / 100.0);
                noise = next;
                if has_settled {
                    break;
                }
            }
            if is_near(noise, before, SETTLED) {
                break;
            }
        }
        let covariance = solve(&self.blocks(views, camera)?, noise, 0.0)?.covariance;
        Some((self, noise, covariance.fixed_view::<6, 6>(0, 0).into()))
    }

    /// From where each corner of a picture should be seen to where it is, in pixels.
    pub fn residuals(&self, index: usize, view: &View, camera: &CameraModel) -> Option<Vec<Vector2<f64>>> {
        let to_camera = (self.tools[index] * self.camera).inverse() * self.board;
        let residual = |corner: &BoardCorner| {
            let point = to_camera * Point3::new(corner.board_mm[0], corner.board_mm[1], 0.0);
            let pixel = camera.pixel([point.x / point.z, point.y / point.z]).filter(|_| point.z > 0.0)?;
            Some(Vector2::from(corner.pixel) - Vector2::from(pixel))
        };
        view.corners.iter().map(residual).collect()
    }

    /// The distance of each tool from where the arm reported it: a turn in radians and a translation, along the axes of the base.
    pub fn off(&self, index: usize, view: &View) -> Vector6<f64> {
        let tool = &self.tools[index];
        let turn = (tool.rotation * view.tool.rotation.inverse()).scaled_axis();
        let translation = tool.translation.vector - view.tool.translation.vector;
        Vector6::new(turn.x, turn.y, turn.z, translation.x, translation.y, translation.z)
    }

    /// The method of Levenberg and Marquardt.
    fn descended(mut self, views: &[View], camera: &CameraModel, noise: Noise) -> Option<HandEyeFit> {
        let mut cost = self.cost(views, camera, noise)?;
        let mut damping = 1e-6;
        for _ in 0..MAX_ITERATIONS {
            let step = solve(&self.blocks(views, camera)?, noise, damping)?;
            let moved = self.moved(&step);
            match moved.cost(views, camera, noise).filter(|moved| *moved < cost) {
                Some(lower) => {
                    let is_done = cost - lower < 1e-9 * cost;
                    (self, cost, damping) = (moved, lower, (damping / 10.0).max(1e-12));
                    if is_done {
                        break;
                    }
                }
                None if damping > 1e6 => break,
                None => damping *= 10.0,
            }
        }
        Some(self)
    }

    fn cost(&self, views: &[View], camera: &CameraModel, noise: Noise) -> Option<f64> {
        let of_view = |(index, view): (usize, &View)| {
            let corners: f64 = self.residuals(index, view, camera)?.iter().map(|residual| residual.norm_squared()).sum();
            let off = self.off(index, view).component_mul(&noise.information());
            Some(corners / noise.corners_px.powi(2) + off.dot(&self.off(index, view)))
        };
        views.iter().enumerate().map(of_view).sum()
    }

    /// The scatter of the corners about the pose of the board that each picture shows.
    fn corner_noise(&self, views: &[View], camera: &CameraModel) -> Option<f64> {
        let (mut squares, mut count) = (0.0, 0);
        for (index, view) in views.iter().enumerate() {
            squares += self.residuals(index, view, camera)?.iter().map(|residual| residual.norm_squared()).sum::<f64>();
            count += 2 * view.corners.len();
        }
        let freedom = count.saturating_sub(6 * views.len()).max(1);
        Some((squares / freedom as f64).sqrt().max(1e-4))
    }

    fn moved(&self, step: &Step) -> HandEyeFit {
        let moved = |pose: &Isometry3<f64>, step: Vector6<f64>| {
            let rotation = UnitQuaternion::new(step.fixed_rows::<3>(0).into_owned()) * pose.rotation;
            Isometry3::from_parts(Translation3::from(pose.translation.vector + step.fixed_rows::<3>(3)), rotation)
        };
        HandEyeFit {
            camera: moved(&self.camera, step.shared.fixed_rows::<6>(0).into()),
            board: moved(&self.board, step.shared.fixed_rows::<6>(6).into()),
            tools: self.tools.iter().zip(&step.tools).map(|(tool, step)| moved(tool, *step)).collect(),
        }
    }

    fn blocks(&self, views: &[View], camera: &CameraModel) -> Option<Vec<Block>> {
        let block = |(index, view): (usize, &View)| {
            let mut block = Block {
                shared: SMatrix::zeros(),
                own: Matrix6::zeros(),
                coupling: SMatrix::zeros(),
                shared_right: SVector::zeros(),
                own_right: Vector6::zeros(),
                off: self.off(index, view),
            };
            for corner in view.corners {
                let (residual, by_shared, by_tool) = self.row(index, corner, camera)?;
                block.shared += by_shared.transpose() * by_shared;
                block.own += by_tool.transpose() * by_tool;
                block.coupling += by_shared.transpose() * by_tool;
                block.shared_right += by_shared.transpose() * residual;
                block.own_right += by_tool.transpose() * residual;
            }
            Some(block)
        };
        views.iter().enumerate().map(block).collect()
    }

    /// The error of a corner in pixels, and the derivatives of its pixel by the shared parameters and by the pose of the tool. A
    /// small rotation `w` of a pose moves a point that it has turned by `w x point`.
    fn row(
        &self,
        index: usize,
        corner: &BoardCorner,
        camera: &CameraModel,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, SHARED>, SMatrix<f64, 2, 6>)> {
        let tool = &self.tools[index];
        let on_board = self.board.rotation * Vector3::new(corner.board_mm[0], corner.board_mm[1], 0.0);
        let from_tool = on_board + self.board.translation.vector - tool.translation.vector;
        let from_camera = tool.rotation.inverse() * from_tool - self.camera.translation.vector;
        let (pixel, by_point) = projection(camera, &(self.camera.rotation.inverse() * from_camera))?;
        let by_tool_point: Matrix2x3<f64> = by_point * self.camera.rotation.inverse().to_rotation_matrix().into_inner();
        let by_base_point: Matrix2x3<f64> = by_tool_point * tool.rotation.inverse().to_rotation_matrix().into_inner();
        let mut by_shared = SMatrix::<f64, 2, SHARED>::zeros();
        by_shared.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_tool_point * from_camera.cross_matrix()));
        by_shared.fixed_view_mut::<2, 3>(0, 3).copy_from(&-by_tool_point);
        by_shared.fixed_view_mut::<2, 3>(0, 6).copy_from(&(by_base_point * -on_board.cross_matrix()));
        by_shared.fixed_view_mut::<2, 3>(0, 9).copy_from(&by_base_point);
        let mut by_tool = SMatrix::<f64, 2, 6>::zeros();
        by_tool.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_base_point * from_tool.cross_matrix()));
        by_tool.fixed_view_mut::<2, 3>(0, 3).copy_from(&-by_base_point);
        Some((Vector2::from(corner.pixel) - pixel, by_shared, by_tool))
    }
}

impl Noise {
    /// The information about how far a tool is from where the arm reported it.
    fn information(&self) -> Vector6<f64> {
        let [turn, translation] = [self.rotation, self.translation_mm].map(|deviation| deviation.powi(-2));
        Vector6::new(turn, turn, turn, translation, translation, translation)
    }
}

/// Solves the equations, given the noise.
fn solve(blocks: &[Block], noise: Noise, damping: f64) -> Option<Step> {
    let weight = noise.corners_px.powi(-2);
    let information = noise.information();
    let (mut matrix, mut right) = (SMatrix::<f64, SHARED, SHARED>::zeros(), SVector::<f64, SHARED>::zeros());
    let mut eliminated = Vec::new();
    for block in blocks {
        let own = block.own * weight + Matrix6::from_diagonal(&information);
        let own = own + Matrix6::from_diagonal(&own.diagonal()) * damping;
        let own_right = block.own_right * weight - information.component_mul(&block.off);
        let (coupling, inverse) = (block.coupling * weight, own.cholesky()?.inverse());
        matrix += block.shared * weight - coupling * inverse * coupling.transpose();
        right += block.shared_right * weight - coupling * inverse * own_right;
        eliminated.push((coupling, inverse, own_right));
    }
    // The damping also keeps the equations solvable.
    let scale = SMatrix::<f64, SHARED, SHARED>::from_diagonal(&matrix.map_diagonal(|own| own.max(1e-30).sqrt().recip()));
    let scaled = scale * matrix * scale + SMatrix::identity() * damping;
    let covariance = scale * scaled.cholesky()?.inverse() * scale;
    let shared = covariance * right;
    let tools = eliminated.iter().map(|(coupling, inverse, right)| inverse * (right - coupling.transpose() * shared)).collect();
    let covariances = eliminated.iter().map(|(coupling, inverse, _)| {
        let by_shared = inverse * coupling.transpose();
        inverse + by_shared * covariance * by_shared.transpose()
    });
    Some(Step { shared, tools, covariance, covariances: covariances.collect() })
}

/// The noise of the arm that makes its poses most likely, by the errors that a solution gives them and how uncertain these are.
fn estimated(blocks: &[Block], step: &Step, noise: Noise, stated: Noise) -> Noise {
    let mean_square = |first: usize, stated: f64| {
        let of_tool = |((block, step), covariance): ((&Block, &Vector6<f64>), &Matrix6<f64>)| {
            let off = (block.off + step).fixed_rows::<3>(first).norm_squared();
            off + covariance.fixed_view::<3, 3>(first, first).trace()
        };
        let sum: f64 = blocks.iter().zip(&step.tools).zip(&step.covariances).map(of_tool).sum();
        (sum + 3.0 * STATED_WEIGHT * stated * stated) / (3.0 * (blocks.len() as f64 + STATED_WEIGHT))
    };
    Noise {
        rotation: mean_square(0, stated.rotation).sqrt(),
        translation_mm: mean_square(3, stated.translation_mm).sqrt(),
        ..noise
    }
}

/// Returns true if the noise of the arm differs by less than a share.
fn is_near(a: Noise, b: Noise, share: f64) -> bool {
    let is_near = |a: f64, b: f64| (a - b).abs() <= share * b;
    is_near(a.rotation, b.rotation) && is_near(a.translation_mm, b.translation_mm)
}
