//! Bundle adjustment: the models of all views and the disparities of all corners that explain the matches best.
//!
//! ```text
//! unknowns: nine parameters of each view (rotation, scale, shift, position) and one disparity of each corner
//! start at the nominal views, and at the mean of each corner's disparities
//! repeat until the cost settles (Levenberg and Marquardt):
//!     weigh each residual down that is large beside the noise (Cauchy)
//!     linearise: each match gives two equations in its view's parameters and its corner's disparity
//!     eliminate the disparities, each of which stands in the equations of its corner alone (Schur complement)
//!     add the priors of the views' parameters, of the mean baseline, and of the turn and the shift that all views share
//!     solve for the views by Cholesky's method, then for each disparity
//!     keep the step and damp less if it lowers the cost; else damp more
//!     lower the noise to the median residual, at most by half, so that all matches count at first
//! ```
//!
//! The priors say which of the unknowns are free: see `selection`.

use multiscopic_core::View;
use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector2, Vector3};
use rayon::prelude::*;

use super::view_geometry::{Direction, Projection, ViewModel};
use crate::statistics::median;

/// The number of parameters of a view.
pub const LEN: usize = ViewModel::LEN;
/// The first of a view's parameters for its rotation, its scale, its shift and its position.
pub const ROTATION: usize = 0;
pub const SCALE: usize = 3;
pub const SHIFT: usize = 4;
pub const POSITION: usize = 6;
/// The maximum number of iterations.
const MAX_ITERATIONS: usize = 200;
/// Residuals above this multiple of their scale lose weight (Cauchy).
const CAUCHY: f64 = 2.0;
/// The standard deviation of the mean length of the baselines, in nominal ones.
const LENGTH_DEVIATION: f64 = 1e-6;
/// The standard deviation of a parameter that is not free.
pub const FIXED: f64 = 1e-7;

/// The standard deviations of the views' parameters before anything is seen: rotations and shifts in radians and focal lengths,
/// the logarithm of the scale, and positions in baselines. Parameters that are [`FIXED`] stay at their nominal values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Shifts, but for the one along the baselines that all views share, which no image shows.
    pub shift: f64,
    /// Rotations about the optical axis.
    pub roll: f64,
    pub scale: f64,
    /// Positions along the baseline.
    pub length: f64,
    /// Rotations about the axes to the right and down, but for the shared one.
    pub turn: f64,
    /// Positions across the baseline.
    pub direction: f64,
    /// Positions ahead of the plane of the views.
    pub ahead: f64,
    /// The turn towards the baselines that all views share.
    pub shared_turn: f64,
}

impl Prior {
    /// The views as they should be.
    pub const NOMINAL: Prior = Prior {
        shift: FIXED,
        roll: FIXED,
        scale: FIXED,
        length: FIXED,
        turn: FIXED,
        direction: FIXED,
        ahead: FIXED,
        shared_turn: FIXED,
    };
    /// Views that a stage has moved without turning the camera on purpose, by an unknown angle to its axes.
    const OF_STAGE: Prior =
        Prior { roll: 2e-4, scale: 1e-6, length: 0.2, turn: 2e-4, direction: 0.2, ahead: 0.2, ..Prior::NOMINAL };

    /// The inverse of the covariance of a view's parameters.
    fn information(&self, view: View) -> SMatrix<f64, LEN, LEN> {
        let deviations =
            [self.turn, self.turn, self.roll, self.scale, self.shift, self.shift, self.length, self.length, self.ahead];
        let mut information = SMatrix::from_diagonal(&SVector::from(deviations.map(|deviation| deviation.powi(-2))));
        let [x, y] = Direction::of(view).across;
        let across = Vector2::new(x, y);
        let more = self.direction.powi(-2) - self.length.powi(-2);
        let mut block = information.fixed_view_mut::<2, 2>(POSITION, POSITION);
        block += across * across.transpose() * more;
        information
    }

    /// The combinations that all views share: the weights of each view's parameters in it, and its standard deviation.
    fn shared(&self, views: &[View]) -> [(DVector<f64>, f64); 3] {
        let squares: f64 = views.iter().map(|&view| nominal(view).position.norm_squared()).sum();
        [
            (shared_turn(views), self.shared_turn),
            (weights(views, SHIFT, |place| place / (place.norm_squared() * views.len() as f64)), FIXED),
            // Longer baselines and smaller disparities explain the matches just as well, so this holds them.
            (weights(views, POSITION, |place| place / squares), LENGTH_DEVIATION),
        ]
    }
}

/// The weights of all views' parameters in the turn towards the baselines that they share.
pub fn shared_turn(views: &[View]) -> DVector<f64> {
    weights(views, ROTATION, |place| Vector2::new(-place.y, place.x) / (place.norm_squared() * views.len() as f64))
}

/// The weights of all parameters, by those of two parameters of each view from the one `at` on, given its nominal place.
fn weights(views: &[View], at: usize, of_view: impl Fn(Vector2<f64>) -> Vector2<f64>) -> DVector<f64> {
    let mut weights = DVector::zeros(views.len() * LEN);
    for (k, &view) in views.iter().enumerate() {
        weights.fixed_rows_mut::<2>(k * LEN + at).copy_from(&of_view(nominal(view).position.xy()));
    }
    weights
}

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
    pub fn undistorted(&self, distortion: f64) -> Point {
        let undistorted = |[x, y]: [f64; 2]| [x, y].map(|at| at / (1.0 + distortion * (x * x + y * y)));
        let seen = self.seen.iter().map(|seen| seen.map(undistorted)).collect();
        Point { ray: undistorted(self.ray), seen, ..*self }
    }
}

/// The models of all views, and how well they explain the matches.
#[derive(Clone, Debug)]
pub struct Adjustment {
    pub models: Vec<ViewModel>,
    /// The disparity of each point, in focal lengths.
    pub disparities: Vec<f64>,
    /// The scale of the residuals, in focal lengths.
    pub noise: f64,
    /// The cost of matches and priors, with the noise of the solution from which this one started.
    pub cost: f64,
}

/// Adjusts the models of views that a stage has moved without turning the camera, and gives the covariance of their parameters.
pub fn adjust_moved(views: &[View], points: &[Point], pixel: f64) -> Option<(Adjustment, DMatrix<f64>)> {
    let solver = Solver { views, points, pixel, prior: Prior::OF_STAGE };
    let adjustment = solver.solve(None)?;
    let covariance = solver.covariance(&adjustment)?;
    Some((adjustment, covariance))
}

/// The models of views as their matches and a prior make them likely.
#[derive(Clone, Copy)]
pub struct Solver<'a> {
    pub views: &'a [View],
    pub points: &'a [Point],
    /// The focal lengths of a pixel.
    pub pixel: f64,
    pub prior: Prior,
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

impl Solver<'_> {
    /// The most likely models, from a start or from the nominal ones. `None` if nothing determines them.
    pub fn solve(&self, start: Option<&Adjustment>) -> Option<Adjustment> {
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
        // What the two solutions are compared by has the same scale of noise in both.
        let noise_of_both = start.map_or(noise, |start| start.noise);
        let cost = self.cost(&models, &disparities, noise_of_both);
        Some(Adjustment { models, disparities, noise, cost })
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
        let residuals: Vec<f64> = self.residuals(models, disparities).into_iter().map(|[x, y]| x.hypot(y)).collect();
        if residuals.is_empty() {
            return 1.0;
        }
        (median(residuals) / 1.1774).max(1e-6)
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
        let off = self.off(models);
        let prior = self.views.iter().enumerate().map(|(k, &view)| {
            let off = off.fixed_rows::<LEN>(k * LEN);
            off.dot(&(self.prior.information(view) * off))
        });
        let shared =
            self.prior.shared(self.views).into_iter().map(|(weights, deviation)| (weights.dot(&off) / deviation).powi(2));
        self.residuals(models, disparities).into_iter().map(of_match).sum::<f64>() + prior.sum::<f64>() + shared.sum::<f64>()
    }

    /// The distances of all views' parameters from their nominal values.
    pub fn off(&self, models: &[ViewModel]) -> DVector<f64> {
        let off = models.iter().zip(self.views).flat_map(|(model, &view)| {
            let [model, nominal] = [*model, nominal(view)].map(|model| SVector::from(model.to_array()));
            (model - nominal).data.0[0]
        });
        DVector::from_iterator(models.len() * LEN, off)
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

    /// The information of the priors, before any match.
    fn prior_information(&self) -> DMatrix<f64> {
        let len = self.views.len() * LEN;
        let mut matrix = DMatrix::zeros(len, len);
        for (k, &view) in self.views.iter().enumerate() {
            matrix.fixed_view_mut::<LEN, LEN>(k * LEN, k * LEN).copy_from(&self.prior.information(view));
        }
        for (weights, deviation) in self.prior.shared(self.views) {
            matrix += &weights * weights.transpose() * deviation.powi(-2);
        }
        matrix
    }

    fn reduced(&self, points: &[Vec<Row>], models: &[ViewModel], damping: f64) -> Reduced {
        let off = self.off(models);
        let mut matrix = self.prior_information();
        let mut right = -&matrix * off;
        for rows in points {
            let [own, own_right] = of_disparity(rows);
            let own = own * (1.0 + damping);
            for row in rows {
                let mut block = matrix.fixed_view_mut::<LEN, LEN>(row.view * LEN, row.view * LEN);
                block += row.by_model.transpose() * row.by_model * row.weight;
                let mut part = right.fixed_rows_mut::<LEN>(row.view * LEN);
                part += row.by_model.transpose() * row.residual * row.weight;
            }
            if own == 0.0 {
                continue;
            }
            for a in rows {
                let of_a = a.coupling();
                let mut part = right.fixed_rows_mut::<LEN>(a.view * LEN);
                part -= of_a * (own_right / own);
                for b in rows {
                    let mut block = matrix.fixed_view_mut::<LEN, LEN>(a.view * LEN, b.view * LEN);
                    block -= of_a * b.coupling().transpose() / own;
                }
            }
        }
        Reduced { matrix, right }
    }
}

impl Row {
    /// The coupling of the view's parameters and the point's disparity.
    fn coupling(&self) -> SVector<f64, LEN> {
        self.by_model.transpose() * self.by_disparity * self.weight
    }
}

/// The information about a point's disparity, and the gradient by it.
fn of_disparity(rows: &[Row]) -> [f64; 2] {
    let own = |row: &Row| row.weight * row.by_disparity.norm_squared();
    let right = |row: &Row| row.weight * row.by_disparity.dot(&row.residual);
    [rows.iter().map(own).sum(), rows.iter().map(right).sum()]
}

/// The number of blocks of the image across and down whose errors are taken for independent.
const BLOCKS: [usize; 2] = [4, 4];

impl Solver<'_> {
    /// The covariance of the parameters of all views, one view after the other, whatever the distribution of the errors, which
    /// may be alike within a block of the image (the sandwich estimate of White and of Liang and Zeger).
    ///
    /// ```text
    /// bread = the matrix of the normal equations, with the second derivatives of the cost of the matches
    /// meat  = over the blocks, the sum of the products of their gradients, and the information of the priors
    /// covariance = bread^-1 meat bread^-1
    /// ```
    pub fn covariance(&self, adjustment: &Adjustment) -> Option<DMatrix<f64>> {
        let Adjustment { models, disparities, noise, .. } = adjustment;
        let rows = self.rows(models, disparities, *noise);
        let prior = self.prior_information();
        // The second derivative of the cost of a match is less than its weight, which is the first over the residual.
        let (mut weights, mut curvatures) = (0.0, 0.0);
        for row in rows.iter().flatten() {
            let weight = row.weight * noise * noise;
            weights += weight;
            curvatures += weight - weight * weight * row.residual.norm_squared() / (CAUCHY * noise).powi(2);
        }
        let bread = (self.reduced(&rows, models, 0.0).matrix - &prior) * (curvatures / weights) + &prior;
        let mut gradients = vec![None; BLOCKS[0] * BLOCKS[1]];
        let block = self.block();
        for (point, rows) in self.points.iter().zip(&rows) {
            let [own, own_right] = of_disparity(rows);
            let gradient: &mut DVector<f64> = gradients[block(point)].get_or_insert_with(|| DVector::zeros(prior.nrows()));
            for row in rows {
                let mut part = gradient.fixed_rows_mut::<LEN>(row.view * LEN);
                part += row.by_model.transpose() * row.residual * row.weight - row.coupling() * (own_right / own.max(1e-9));
            }
        }
        let count = gradients.iter().flatten().count() as f64;
        // The more parameters are fitted, the smaller the sums over blocks.
        let freedom = f64::max(count - LEN as f64, 1.0);
        let meat = gradients
            .iter()
            .flatten()
            .fold(prior.clone(), |sum, gradient| sum + gradient * gradient.transpose() * (count / freedom));
        let inverse = bread.cholesky()?.inverse();
        Some(&inverse * meat * &inverse)
    }

    /// The block of the image in which a point lies.
    fn block(&self) -> impl Fn(&Point) -> usize {
        let ends = [0, 1].map(|axis| {
            let along = self.points.iter().map(move |point| point.ray[axis]);
            [along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max)]
        });
        move |point| {
            let [column, row] = [0, 1].map(|axis| {
                let [first, last] = ends[axis];
                let share = (point.ray[axis] - first) / (last - first).max(f64::MIN_POSITIVE);
                ((share * BLOCKS[axis] as f64) as usize).min(BLOCKS[axis] - 1)
            });
            row * BLOCKS[0] + column
        }
    }

    /// The places at which the models let the views show each point, in focal lengths: in the order of the matches.
    pub fn expected(&self, adjustment: &Adjustment) -> Vec<[f64; 2]> {
        let projections: Vec<Projection> = adjustment.models.iter().map(ViewModel::projection).collect();
        let of_point = |(point, &d): (&Point, &f64)| {
            let ray = Vector3::new(point.ray[0], point.ray[1], 1.0);
            let seen = point.seen.iter().zip(&projections);
            seen.filter_map(|(seen, model)| seen.map(|_| model.project(ray, d))).collect::<Vec<_>>()
        };
        self.points.iter().zip(&adjustment.disparities).flat_map(of_point).collect()
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
pub fn nominal(view: View) -> ViewModel {
    let position = Vector3::new(view.right().into(), view.down().into(), 0.0);
    ViewModel { position, ..ViewModel::NEUTRAL }
}
