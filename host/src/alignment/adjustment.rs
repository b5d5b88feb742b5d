//! Bundle adjustment: the models of all views and the disparities of all corners that explain the matches best.
//!
//! ```text
//! unknowns: seven parameters of each view (rotation, scale, position) and one disparity of each corner
//! start at the nominal views, and at the mean of each corner's disparities
//! repeat until the cost settles (Levenberg and Marquardt):
//!     weigh each residual down that is large beside the noise (Cauchy)
//!     linearise: each match gives two equations in its view's parameters and its corner's disparity
//!     eliminate the disparities, each of which stands in the equations of its corner alone (Schur complement)
//!     add the priors of the views' parameters, of the mean baseline and of the turn that all views share
//!     solve for the views by Cholesky's method, then for each disparity
//!     keep the step and damp less if it lowers the cost; else damp more
//!     lower the noise to the median residual, at most by half, so that all matches count at first
//! ```
//!
//! All disparities plus a constant and a turn of all views towards their baselines look alike but for the perspective at the
//! borders, and so does a lens that distorts. So [`adjust`] solves with that turn fixed and with it free, and believes in it
//! only if the views' own turns make it likely, or if it explains much more than no turn and more than any lens.

use multiscopic_core::View;
use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector3};

use rayon::prelude::*;

use super::view_geometry::{Projection, ViewModel};

/// The number of parameters of a view.
const LEN: usize = ViewModel::LEN;
/// Standard deviations of the parameters before anything is seen: rotations in radians, the logarithm of the scale, and
/// positions in baselines, as arms, slides and hands have them.
const PRIOR: [f64; LEN] = [0.02, 0.02, 0.02, 0.01, 0.05, 0.05, 0.05];
/// Those of views that a stage has moved without turning the camera on purpose, by an unknown angle to its axes.
const PRIOR_OF_STAGE: [f64; LEN] = [2e-4, 2e-4, 2e-4, 1e-6, 0.2, 0.2, 0.2];
/// The maximum number of iterations.
const MAX_ITERATIONS: usize = 200;
/// Residuals above this multiple of their scale lose weight (Cauchy).
const CAUCHY: f64 = 2.0;
/// The standard deviation of the mean length of the baselines, in nominal ones. Longer baselines and smaller disparities
/// explain the matches just as well, so this holds it.
const LENGTH_DEVIATION: f64 = 1e-6;
/// The largest credible turn that the views share, in multiples of the spread of their turns towards their baselines.
const LIKELY: f64 = 2.0;
/// The factor by which the matches' error must fall for the turn to be believed in any case.
const CLEAR_GAIN: f64 = 0.8;
/// The factor by which it must fall for a lens to be suspected.
const NOTICEABLE_GAIN: f64 = 0.95;
/// A turn that is not free, in radians.
const FIXED: f64 = 1e-7;
/// Distortions that may explain the matches instead: the displacement at a focal length from the optical axis, in focal
/// lengths.
const DISTORTIONS: [f64; 8] = [-0.4, -0.25, -0.15, -0.08, -0.04, 0.04, 0.08, 0.15];

/// A corner of the centre and where the views show it, all in focal lengths from the optical axis.
#[derive(Clone, Debug)]
pub struct Point {
    /// The corner's index.
    pub corner: usize,
    pub ray: [f64; 2],
    /// In each view that it was found in.
    pub seen: Vec<Option<[f64; 2]>>,
}

impl Point {
    /// The point without the distortion of a lens, by the division model (Fitzgibbon, 2001).
    fn undistorted(&self, distortion: f64) -> Point {
        let undistorted = |[x, y]: [f64; 2]| [x, y].map(|at| at / (1.0 + distortion * (x * x + y * y)));
        let seen = self.seen.iter().map(|seen| seen.map(undistorted)).collect();
        Point { ray: undistorted(self.ray), seen, ..*self }
    }
}

/// The models of all views, and how well they explain the matches.
#[derive(Clone, Debug)]
pub struct Adjustment {
    pub models: Vec<ViewModel>,
    /// The standard deviations of their parameters.
    pub deviations: Vec<[f64; LEN]>,
    /// The covariance of the parameters of all views, one view after the other.
    pub covariance: DMatrix<f64>,
    /// The disparity of each point, in focal lengths.
    pub disparities: Vec<f64>,
    /// The scale of the residuals, in focal lengths.
    pub noise: f64,
    /// The matches ask for a turn of all views towards their baselines, and still more for a lens that distorts.
    pub looks_distorted: bool,
    cost: f64,
}

/// Adjusts the models of `views`.
///
/// If all views are turned towards their baselines alike, all disparities change by the same amount, and nothing else does but
/// the perspective at the borders, which a lens distorts alike. Such a turn is believed if the views are turned towards their
/// baselines by different angles as well, or if it explains the matches far better than none and better than a lens.
///
/// A pixel has `pixel` focal lengths.
pub fn adjust(views: &[View], points: &[Point], pixel: f64) -> Option<Adjustment> {
    let fixed = Solver { views, points, pixel, prior: PRIOR, offset_deviation: FIXED }.solve(None)?;
    let free = Solver { views, points, pixel, prior: PRIOR, offset_deviation: PRIOR[0] }.solve(Some(&fixed))?;
    // Views that are turned towards their baselines by different angles probably share a part of them.
    if shared_turn(views, &free.models).abs() <= LIKELY * spread_of_turns(views, &free.models) {
        return Some(free);
    }
    let gain = free.cost / fixed.cost;
    let is_distorted = gain < NOTICEABLE_GAIN
        && DISTORTIONS.par_iter().any(|&distortion| {
            let points: Vec<Point> = points.iter().map(|point| point.undistorted(distortion)).collect();
            let undistorted = Solver { views, points: &points, pixel, prior: PRIOR, offset_deviation: FIXED };
            undistorted.solve(Some(&fixed)).is_some_and(|undistorted| undistorted.cost < free.cost)
        });
    Some(if gain < CLEAR_GAIN && !is_distorted { free } else { Adjustment { looks_distorted: is_distorted, ..fixed } })
}

/// The standard deviation of the angles by which views are turned towards their baselines, in radians; 0 of a single view.
fn spread_of_turns(views: &[View], models: &[ViewModel]) -> f64 {
    let (shared, count) = (shared_turn(views, models), views.len() as f64);
    let squares: f64 = shares_of_turn(views, models).map(|share| (count * share - shared).powi(2)).sum();
    (squares / f64::max(count - 1.0, 1.0)).sqrt()
}

/// The coefficients of a view's rotation in the turn towards the baselines that all views share.
fn shared_weights(views: &[View], view: View) -> [f64; 2] {
    let [x, y] = [view.right(), view.down()].map(f64::from);
    let scale = (x * x + y * y) * views.len() as f64;
    [-y / scale, x / scale]
}

/// The coefficients of a view's position in the mean length of the baselines.
fn length_weights(views: &[View], view: View) -> Vector3<f64> {
    let total: f64 = views.iter().map(|&view| nominal(view).position.norm_squared()).sum();
    nominal(view).position / total
}

/// The mean length of the baselines, in nominal ones.
fn mean_length(views: &[View], models: &[ViewModel]) -> f64 {
    models.iter().zip(views).map(|(model, &view)| length_weights(views, view).dot(&model.position)).sum()
}

/// The turn towards the baselines that all views share, in radians.
fn shared_turn(views: &[View], models: &[ViewModel]) -> f64 {
    shares_of_turn(views, models).sum()
}

/// The contribution of each view to the turn that all share.
fn shares_of_turn(views: &[View], models: &[ViewModel]) -> impl Iterator<Item = f64> {
    models.iter().zip(views).map(|(model, &view)| {
        let [x, y] = shared_weights(views, view);
        x * model.rotation.x + y * model.rotation.y
    })
}

/// Adjusts the models of views that a stage has moved without turning the camera.
pub fn adjust_moved(views: &[View], points: &[Point], pixel: f64) -> Option<Adjustment> {
    Solver { views, points, pixel, prior: PRIOR_OF_STAGE, offset_deviation: FIXED }.solve(None)
}

struct Solver<'a> {
    views: &'a [View],
    points: &'a [Point],
    pixel: f64,
    /// The standard deviations of a view's parameters before anything is seen.
    prior: [f64; LEN],
    /// The standard deviation of the turn towards the baselines that all views share, in radians.
    offset_deviation: f64,
}

/// Normal equations from which the disparities have been eliminated (Schur complement).
struct Reduced {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// The equations of a point in one view.
struct Row {
    view: usize,
    residual: SVector<f64, 2>,
    by_model: SMatrix<f64, 2, LEN>,
    by_disparity: SVector<f64, 2>,
    weight: f64,
}

impl Adjustment {
    /// The standard deviation of a linear combination of the views' positions, given the weights of each view.
    pub fn position_deviation(&self, weights: impl Iterator<Item = [f64; 2]>) -> f64 {
        let mut gradient = DVector::zeros(self.covariance.nrows());
        for (k, [right, down]) in weights.enumerate() {
            gradient[k * LEN + 4] = right;
            gradient[k * LEN + 5] = down;
        }
        (&self.covariance * &gradient).dot(&gradient).sqrt()
    }
}

impl Solver<'_> {
    fn solve(&self, start: Option<&Adjustment>) -> Option<Adjustment> {
        let mut models: Vec<ViewModel> = match start {
            Some(start) => start.models.clone(),
            None => self.views.iter().map(|&view| nominal(view)).collect(),
        };
        let mut disparities: Vec<f64> = match start {
            Some(start) => start.disparities.clone(),
            None => self.points.iter().map(|point| self.first_disparity(point)).collect(),
        };
        // At first all matches count, so that the solution does not stay near its start.
        let mut noise = self.noise(&models, &disparities).max(self.pixel);
        let mut cost = self.cost(&models, &disparities, noise);
        let mut damping = 1e-9;
        for _ in 0..MAX_ITERATIONS {
            let rows = self.rows(&models, &disparities, noise);
            let Reduced { mut matrix, right } = self.reduced(&rows, &models, damping);
            for k in 0..matrix.nrows() {
                matrix[(k, k)] *= 1.0 + damping;
            }
            let step = matrix.cholesky()?.solve(&right);
            let moved: Vec<ViewModel> = models
                .iter()
                .enumerate()
                .map(|(k, model)| {
                    let mut parameters = model.to_array();
                    parameters.iter_mut().zip(step.rows(k * LEN, LEN).iter()).for_each(|(parameter, step)| *parameter += step);
                    ViewModel::from_array(parameters)
                })
                .collect();
            let moved_disparities: Vec<f64> =
                rows.iter().zip(&disparities).map(|(rows, d)| d + disparity_step(rows, &step, damping)).collect();
            let moved_cost = self.cost(&moved, &moved_disparities, noise);
            if moved_cost > cost {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
                continue;
            }
            let is_done = cost - moved_cost < 1e-5 * cost;
            (models, disparities, damping) = (moved, moved_disparities, (damping / 10.0).max(1e-9));
            let less_noise = self.noise(&models, &disparities).max(noise / 2.0).min(noise);
            let is_settled = less_noise > 0.99 * noise && damping <= 1e-7;
            noise = less_noise;
            cost = self.cost(&models, &disparities, noise);
            if is_done && is_settled {
                break;
            }
        }
        let rows = self.rows(&models, &disparities, noise);
        let covariance = self.reduced(&rows, &models, 0.0).matrix.cholesky()?.inverse();
        let deviations = (0..models.len()).map(|k| std::array::from_fn(|i| covariance[(k * LEN + i, k * LEN + i)].sqrt()));
        // What the two solutions are compared by has the same scale of noise in both.
        let noise_of_both = start.map_or(noise, |start| start.noise);
        let cost = self.cost(&models, &disparities, noise_of_both);
        Some(Adjustment {
            deviations: deviations.collect(),
            covariance,
            models,
            disparities,
            noise,
            looks_distorted: false,
            cost,
        })
    }

    /// The mean of a point's disparities in all views at their nominal positions.
    fn first_disparity(&self, point: &Point) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, view) in point.seen.iter().zip(self.views) {
            let Some(seen) = seen else { continue };
            let [x, y] = [view.right(), view.down()].map(f64::from);
            sum -= (x * (seen[0] - point.ray[0]) + y * (seen[1] - point.ray[1])) / (x * x + y * y);
            count += 1.0;
        }
        sum / f64::max(count, 1.0)
    }

    /// The scale of the residuals: that of a normal distribution with their median.
    fn noise(&self, models: &[ViewModel], disparities: &[f64]) -> f64 {
        let mut residuals: Vec<f64> = self.residuals(models, disparities).into_iter().map(|[x, y]| x.hypot(y)).collect();
        if residuals.is_empty() {
            return 1.0;
        }
        let middle = residuals.len() / 2;
        let (_, median, _) = residuals.select_nth_unstable_by(middle, f64::total_cmp);
        (*median / 1.1774).max(1e-6)
    }

    /// The residuals of all matches.
    fn residuals(&self, models: &[ViewModel], disparities: &[f64]) -> Vec<[f64; 2]> {
        let models: Vec<Projection> = models.iter().map(|model| model.projection()).collect();
        let of_point = |(point, &d): (&Point, &f64)| {
            let ray = Vector3::new(point.ray[0], point.ray[1], 1.0);
            let of_view = |(seen, model): (&Option<[f64; 2]>, &Projection)| {
                let ([x, y], seen) = (model.project(ray, d), (*seen)?);
                Some([seen[0] - x, seen[1] - y])
            };
            point.seen.iter().zip(&models).filter_map(of_view).collect::<Vec<_>>()
        };
        self.points.iter().zip(disparities).flat_map(of_point).collect()
    }

    fn cost(&self, models: &[ViewModel], disparities: &[f64], noise: f64) -> f64 {
        let of_match = |[x, y]: [f64; 2]| {
            let square = (x * x + y * y) / (noise * noise);
            CAUCHY * CAUCHY * (square / (CAUCHY * CAUCHY)).ln_1p()
        };
        let prior = models.iter().zip(self.views).map(|(model, &view)| {
            let off = model.to_array().into_iter().zip(nominal(view).to_array()).zip(self.prior);
            off.map(|((value, expected), deviation)| ((value - expected) / deviation).powi(2)).sum::<f64>()
        });
        let offset = shared_turn(self.views, models) / self.offset_deviation;
        let length = (mean_length(self.views, models) - 1.0) / LENGTH_DEVIATION;
        let shared = offset * offset + length * length;
        self.residuals(models, disparities).into_iter().map(of_match).sum::<f64>() + prior.sum::<f64>() + shared
    }

    /// The equations of all points.
    fn rows(&self, models: &[ViewModel], disparities: &[f64], noise: f64) -> Vec<Vec<Row>> {
        let differentials: Vec<Differential> = models.iter().map(|&model| Differential::new(model)).collect();
        let of_point = |(point, &disparity): (&Point, &f64)| {
            let ray = Vector3::new(point.ray[0], point.ray[1], 1.0);
            let row = |(k, (seen, differential)): (usize, (&Option<[f64; 2]>, &Differential))| {
                let project = |model: &Projection, disparity| SVector::<f64, 2>::from(model.project(ray, disparity));
                let Differential { model, varied } = differential;
                let residual = SVector::from((*seen)?) - project(model, disparity);
                let mut by_model = SMatrix::<f64, 2, LEN>::zeros();
                for (i, [ahead, behind]) in varied.iter().enumerate() {
                    by_model.set_column(i, &((project(ahead, disparity) - project(behind, disparity)) / (2.0 * STEP)));
                }
                let by_disparity = (project(model, disparity + STEP) - project(model, disparity - STEP)) / (2.0 * STEP);
                let square = residual.norm_squared() / (noise * noise);
                let weight = 1.0 / (noise * noise * (1.0 + square / (CAUCHY * CAUCHY)));
                Some(Row { view: k, residual, by_model, by_disparity, weight })
            };
            point.seen.iter().zip(&differentials).enumerate().filter_map(row).collect()
        };
        self.points.par_iter().zip(disparities).map(of_point).collect()
    }

    fn reduced(&self, points: &[Vec<Row>], models: &[ViewModel], damping: f64) -> Reduced {
        let len = models.len() * LEN;
        let (mut matrix, mut right) = (DMatrix::zeros(len, len), DVector::zeros(len));
        for (k, (model, &view)) in models.iter().zip(self.views).enumerate() {
            let off = model.to_array().into_iter().zip(nominal(view).to_array()).zip(self.prior);
            for (i, ((value, expected), deviation)) in off.enumerate() {
                matrix[(k * LEN + i, k * LEN + i)] += deviation.powi(-2);
                right[k * LEN + i] -= (value - expected) * deviation.powi(-2);
            }
        }
        let (mut turn, mut length) = (DVector::zeros(len), DVector::zeros(len));
        for (k, &view) in self.views.iter().enumerate() {
            let [x, y] = shared_weights(self.views, view);
            (turn[k * LEN], turn[k * LEN + 1]) = (x, y);
            length.fixed_rows_mut::<3>((k + 1) * LEN - 3).copy_from(&length_weights(self.views, view));
        }
        for (weights, off, deviation) in [
            (turn, shared_turn(self.views, models), self.offset_deviation),
            (length, mean_length(self.views, models) - 1.0, LENGTH_DEVIATION),
        ] {
            let information = deviation.powi(-2);
            matrix += &weights * weights.transpose() * information;
            right -= weights * (off * information);
        }
        for rows in points {
            let own: f64 = rows.iter().map(|row| row.weight * row.by_disparity.norm_squared()).sum::<f64>() * (1.0 + damping);
            let own_right: f64 = rows.iter().map(|row| row.weight * row.by_disparity.dot(&row.residual)).sum();
            for row in rows {
                let mut block = matrix.fixed_view_mut::<LEN, LEN>(row.view * LEN, row.view * LEN);
                block += row.by_model.transpose() * row.by_model * row.weight;
                let mut part = right.fixed_rows_mut::<LEN>(row.view * LEN);
                part += row.by_model.transpose() * row.residual * row.weight;
            }
            if own == 0.0 {
                continue;
            }
            let coupling = |row: &Row| row.by_model.transpose() * row.by_disparity * row.weight;
            for a in rows {
                let of_a = coupling(a);
                let mut part = right.fixed_rows_mut::<LEN>(a.view * LEN);
                part -= of_a * (own_right / own);
                for b in rows {
                    let mut block = matrix.fixed_view_mut::<LEN, LEN>(a.view * LEN, b.view * LEN);
                    block -= of_a * coupling(b).transpose() / own;
                }
            }
        }
        Reduced { matrix, right }
    }
}

/// The step of numeric derivatives.
const STEP: f64 = 1e-6;

/// A model, and it with each of its parameters a step ahead and a step behind.
struct Differential {
    model: Projection,
    varied: [[Projection; 2]; LEN],
}

impl Differential {
    fn new(model: ViewModel) -> Differential {
        let varied = |i: usize, step: f64| {
            let mut parameters = model.to_array();
            parameters[i] += step;
            ViewModel::from_array(parameters).projection()
        };
        Differential { model: model.projection(), varied: std::array::from_fn(|i| [varied(i, STEP), varied(i, -STEP)]) }
    }
}

/// The change of a point's disparity, given that of the models.
fn disparity_step(rows: &[Row], step: &DVector<f64>, damping: f64) -> f64 {
    let (mut own, mut right) = (0.0, 0.0);
    for row in rows {
        let moved = row.by_model * step.fixed_rows::<LEN>(row.view * LEN);
        own += row.weight * row.by_disparity.norm_squared() * (1.0 + damping);
        right += row.weight * row.by_disparity.dot(&(row.residual - moved));
    }
    if own == 0.0 { 0.0 } else { right / own }
}

/// A view where it should be.
fn nominal(view: View) -> ViewModel {
    let position = Vector3::new(view.right().into(), view.down().into(), 0.0);
    ViewModel { rotation: Vector3::zeros(), log_scale: 0.0, position }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points at all depths, seen by views that are turned by up to a degree, scaled by up to a percent and off their places by
    /// up to two percent of the baseline.
    #[test]
    fn models_are_found_from_exact_matches() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut within = |most: f64| most * (2.0 * random.f64() - 1.0);
        let views = View::CROSS;
        let models: Vec<ViewModel> = views
            .iter()
            .map(|&view| {
                let [turn, off] = [0.017, 0.02].map(|most| Vector3::from_fn(|_, _| within(most)));
                ViewModel { rotation: turn, log_scale: within(0.01), position: nominal(view).position + off }
            })
            .collect();
        let points: Vec<Point> = (0..120)
            .map(|corner| {
                let (ray, disparity) = ([within(0.4), within(0.3)], 0.03 + within(0.02));
                let seen = |model: &ViewModel| model.projection().project(Vector3::new(ray[0], ray[1], 1.0), disparity);
                Point { corner, ray, seen: models.iter().map(|model| Some(seen(model))).collect() }
            })
            .collect();
        let found = adjust(&views, &points, 1e-3).unwrap();
        for (found, model) in found.models.iter().zip(&models) {
            let [turn, scale] = [(found.rotation - model.rotation).norm(), (found.log_scale - model.log_scale).abs()];
            // A thirtieth of a pixel of a thousandth.
            assert!(turn < 3e-5 && scale < 3e-5, "{found:?} instead of {model:?}");
        }
        // All lengths are known up to a factor: their mean is that of the nominal positions.
        let factor = found.models[0].position.norm() / models[0].position.norm();
        for (found, model) in found.models.iter().zip(&models) {
            let off = (found.position / factor - model.position).norm();
            assert!(off < 1e-3 && (factor - 1.0).abs() < 0.02, "{found:?} instead of {model:?}");
        }
    }
}
