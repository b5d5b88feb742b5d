//! The parameters that the images prove: each parameter stays at its nominal value unless it explains more than noise.
//!
//! ```text
//! free the shifts, rolls, scales and lengths of baselines, and adjust: they differ in what they do to the matches
//! for each group of the other parameters:
//!     free it too, and adjust; keep it free if it is significant and moves some matches noticeably
//! for each free group, the last first:
//!     hold it again, and adjust; leave it out if it was not significant, or its absence moves no match noticeably
//! deviations = those with everything free, so that what the images do not tell apart is uncertain
//! ```
//!
//! A group is significant if its Wald statistic is, with a covariance that allows for errors which neighbours share, as those of
//! an imperfect lens. It is noticeable if it moves one match in twenty, or the nearest points, which may be few, by their lengths
//! of baselines.

use multiscopic_core::{Frame, View};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    adjustment::{Adjustment, FIXED, LEN, POSITION, Point, Prior, ROTATION, SCALE, SHIFT, Solver, shared_turn},
    view_geometry::{Direction, ViewModel},
};
use crate::{files::Rig, statistics::quantile};

/// The standard deviations of parameters that are free, as arms, slides and hands have them.
const FREE: Prior =
    Prior { shift: 0.02, roll: 0.02, scale: 0.01, length: 0.05, turn: 0.02, direction: 0.05, ahead: 0.05, shared_turn: 0.02 };
/// The standard deviations of poses that an arm has measured, and of the moves of usual stages, in millimetres and degrees.
const MEASURED: [f64; 2] = [0.05, 0.01];
const USUAL: [f64; 2] = [0.1, 0.05];
/// The standard deviation of a calibrated mount about each axis, in degrees.
const MOUNT_DEG: f64 = 0.05;
/// The least Wald statistic of a group that is significant, for each of its parameters. Those of noise stay
/// below it: see the tests.
const SIGNIFICANT: f64 = 12.0;
/// The distance by which a group must move matches, in pixels.
const NOTICEABLE_PX: f64 = 0.1;
/// The share of matches that it may leave where they are.
const UNMOVED: f64 = 0.95;
/// The share of matches that are not nearest.
const NOT_NEAREST: f64 = 0.99;
/// The largest credible turn that the views share, in multiples of the spread of their turns towards their baselines.
const LIKELY: f64 = 2.0;
/// The factor by which the matches' error must fall for a lens to be suspected.
const NOTICEABLE_GAIN: f64 = 0.95;
/// Distortions that may explain the matches instead: the displacement at a focal length from the optical axis, in focal
/// lengths.
const DISTORTIONS: [f64; 8] = [-0.4, -0.25, -0.15, -0.08, -0.04, 0.04, 0.08, 0.15];

/// The distances of a calibrated rig's views from where they should be: standard deviations.
///
/// Lens and mount are known then, and a stage moves the camera about as it should: alignment estimates what is left
/// within these, and nothing else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Of a view's turn about each axis, in radians.
    pub turn: f64,
    /// Of its place along each axis, in baselines.
    pub position: f64,
    /// Of the camera's turn against the stage about each axis, in radians.
    pub mount: f64,
}

impl Tolerance {
    /// The tolerance of a rig whose lens and mount are calibrated. `None` of others.
    ///
    /// Poses that a stage measured are off by less than stages are; the rig may know how well its own repeats.
    pub fn of_rig(rig: &Rig) -> Option<Tolerance> {
        let (Some(_), Some(_), Some(baseline_mm)) = (&rig.lens, rig.mount_rotation_deg, rig.baseline_mm) else { return None };
        let is_measured = |view: View| rig.pose(Frame::View(view)).is_some_and(|pose| pose.measured.is_some());
        let [mm, deg] = if rig.images.views().iter().all(is_measured) { MEASURED } else { USUAL };
        let position = rig.capture.repeatability_mm.unwrap_or(mm) / baseline_mm;
        Some(Tolerance { turn: deg.to_radians(), position, mount: MOUNT_DEG.to_radians() })
    }

    /// The deviations of parameters that are free. A lens that is calibrated neither shifts nor scales images.
    fn free(self, views: usize) -> Prior {
        let Tolerance { turn, position, .. } = self;
        let shared_turn = turn / (views as f64).sqrt();
        Prior {
            shift: FIXED,
            roll: turn,
            scale: FIXED,
            length: position,
            turn,
            direction: position,
            ahead: position,
            shared_turn,
        }
    }
}

/// Parameters of all views that are free together, in the order in which they are tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Group {
    Shift,
    Roll,
    Scale,
    Length,
    Turn,
    SharedTurn,
    Direction,
    Ahead,
}

impl Group {
    /// Its name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Group::Shift => "shift",
            Group::Roll => "roll",
            Group::Scale => "scale",
            Group::Length => "length of baselines",
            Group::Turn => "turn",
            Group::SharedTurn => "turn towards the baselines",
            Group::Direction => "direction of baselines",
            Group::Ahead => "distance ahead",
        }
    }

    /// The groups that hardly change disparities beside each other.
    const HARMLESS: [Group; 4] = [Group::Shift, Group::Roll, Group::Scale, Group::Length];
    /// The groups that are easily taken for the others.
    const OTHERS: [Group; 4] = [Group::Turn, Group::SharedTurn, Group::Direction, Group::Ahead];

    /// The prior with this group `free`.
    fn freed(self, prior: Prior, free: Prior) -> Prior {
        match self {
            Group::Shift => Prior { shift: free.shift, ..prior },
            Group::Roll => Prior { roll: free.roll, ..prior },
            Group::Scale => Prior { scale: free.scale, ..prior },
            Group::Length => Prior { length: free.length, ..prior },
            Group::Turn => Prior { turn: free.turn, ..prior },
            Group::SharedTurn => Prior { shared_turn: free.shared_turn, turn: free.turn, ..prior },
            Group::Direction => Prior { direction: free.direction, ..prior },
            Group::Ahead => Prior { ahead: free.ahead, ..prior },
        }
    }

    /// The combinations of all parameters that the group adds, as rows.
    fn combinations(self, views: &[View]) -> DMatrix<f64> {
        let len = views.len() * LEN;
        let of_view = |k: usize, at: usize, weights: &[f64]| {
            let mut row = DVector::zeros(len);
            row.as_mut_slice()[k * LEN + at..][..weights.len()].copy_from_slice(weights);
            row
        };
        let mut rows = Vec::new();
        for (k, &view) in views.iter().enumerate() {
            let Direction { along, across, .. } = Direction::of(view);
            let [x, y] = along;
            // All but one along the baselines are independent: together they have none.
            let others = k > 0;
            match self {
                Group::Shift => {
                    rows.push(of_view(k, SHIFT, &across));
                    rows.extend(others.then(|| of_view(k, SHIFT, &along)));
                }
                Group::Roll => rows.push(of_view(k, ROTATION + 2, &[1.0])),
                Group::Scale => rows.push(of_view(k, SCALE, &[1.0])),
                Group::Length => rows.extend(others.then(|| of_view(k, POSITION, &along))),
                Group::Turn => {
                    rows.push(of_view(k, ROTATION, &along));
                    rows.extend(others.then(|| of_view(k, ROTATION, &[-y, x])));
                }
                Group::SharedTurn => rows = Vec::from([shared_turn(views)]),
                Group::Direction => rows.push(of_view(k, POSITION, &across)),
                Group::Ahead => rows.push(of_view(k, POSITION + 2, &[1.0])),
            }
        }
        let mut matrix = DMatrix::zeros(rows.len(), len);
        rows.iter().enumerate().for_each(|(n, row)| matrix.row_mut(n).tr_copy_from(row));
        matrix
    }
}

/// The models of all views with what the images prove.
#[derive(Clone, Debug)]
pub struct Selection {
    pub adjustment: Adjustment,
    /// The groups that differ from the nominal views.
    pub proven: Vec<Group>,
    /// The models if all parameters are free: what the matches and the priors make likely.
    pub likely: Vec<ViewModel>,
    /// The covariance of these parameters, one view after the other.
    pub covariance: DMatrix<f64>,
    /// The matches ask for a turn of all views towards their baselines, and still more for a lens that distorts.
    pub looks_distorted: bool,
}

impl Selection {
    /// Adjusts the models of `views`, within a tolerance if the rig is calibrated. A pixel has `pixel` focal lengths.
    ///
    /// If all views are turned towards their baselines alike, all disparities change by the same amount, and nothing else does
    /// but the perspective at the borders, which a lens distorts alike. So the turn must explain more than any lens, too. The
    /// epipolar errors of a single neighbour are too few to prove it: what noise may pass for moves all disparities by pixels.
    /// In a calibrated rig it is what the turns of single views within their tolerance have in common.
    pub fn of(views: &[View], points: &[Point], pixel: f64, tolerance: Option<Tolerance>) -> Option<Selection> {
        let most = tolerance.map_or(FREE, |tolerance| tolerance.free(views.len()));
        let nominal = match tolerance {
            Some(_) => Prior { shared_turn: most.shared_turn, ..Prior::NOMINAL },
            None => Prior::NOMINAL,
        };
        let solver = |free: &[Group]| {
            let prior = free.iter().fold(nominal, |prior, group| group.freed(prior, most));
            Solver { views, points, pixel, prior }
        };
        let (mut proven, mut looks_distorted) = (Group::HARMLESS.to_vec(), false);
        let mut adjustment = solver(&proven).solve(None)?;
        for group in Group::OTHERS {
            if group == Group::SharedTurn && (views.len() == 1 || tolerance.is_some()) {
                continue;
            }
            let with = [&proven[..], &[group]].concat();
            let Some(candidate) = solver(&with).solve(Some(&adjustment)) else { continue };
            if !differs(&solver(&with), [&candidate, &adjustment], group) || !is_significant(&solver(&with), &candidate, group) {
                continue;
            }
            let explains_more = |&distortion: &f64| {
                let points: Vec<Point> = points.iter().map(|point| point.undistorted(distortion)).collect();
                let undistorted = Solver { points: &points, ..solver(&proven) }.solve(Some(&adjustment));
                undistorted.is_some_and(|undistorted| undistorted.cost < candidate.cost)
            };
            if group == Group::SharedTurn && DISTORTIONS.par_iter().any(explains_more) {
                looks_distorted = candidate.cost < NOTICEABLE_GAIN * adjustment.cost;
                continue;
            }
            (proven, adjustment) = (with, candidate);
        }
        for group in proven.clone().into_iter().rev() {
            let without: Vec<Group> = proven.iter().copied().filter(|&other| other != group).collect();
            let Some(candidate) = solver(&without).solve(Some(&adjustment)) else { continue };
            let differs = differs(&solver(&without), [&candidate, &adjustment], group);
            if !differs || !is_significant(&solver(&proven), &adjustment, group) {
                (proven, adjustment) = (without, candidate);
            }
        }
        // Views whose perspective shows that they are turned by different angles probably share a part of them.
        let is_turned = tolerance.is_none() && proven.contains(&Group::Turn) && !proven.contains(&Group::Shift);
        if is_turned && !looks_distorted && !proven.contains(&Group::SharedTurn) {
            let with = [&proven[..], &[Group::SharedTurn]].concat();
            let candidate = solver(&with).solve(Some(&adjustment));
            if let Some(candidate) = candidate.filter(|candidate| is_likely_shared(views, &candidate.models)) {
                (proven, adjustment) = (with, candidate);
            }
        }
        let all = solver(&[Group::HARMLESS, Group::OTHERS].concat());
        let full = all.solve(Some(&adjustment))?;
        let covariance = all.covariance(&full)?;
        Some(Selection { adjustment, proven, likely: full.models, covariance, looks_distorted })
    }

    /// The standard deviation of a linear combination of all parameters, one view after the other: where some are not proven, as
    /// far as they may be from their nominal values.
    pub fn deviation(&self, weights: &DVector<f64>) -> f64 {
        let off = self.likely.iter().zip(&self.adjustment.models).enumerate().flat_map(|(k, (likely, model))| {
            let weights = weights.rows(k * LEN, LEN);
            likely
                .to_array()
                .into_iter()
                .zip(model.to_array())
                .enumerate()
                .map(move |(i, (likely, value))| weights[i] * (likely - value))
        });
        (&self.covariance * weights).dot(weights).max(0.0).sqrt().hypot(off.sum())
    }

    /// The standard deviations of the parameters of a view.
    pub fn deviations(&self, k: usize) -> [f64; LEN] {
        let unit = |i: usize| DVector::from_fn(self.covariance.nrows(), |n, _| if n == k * LEN + i { 1.0 } else { 0.0 });
        std::array::from_fn(|i| self.deviation(&unit(i)))
    }
}

/// Returns true if the turn towards the baselines that all views share is not large beside the spread of their turns.
fn is_likely_shared(views: &[View], models: &[ViewModel]) -> bool {
    let weights = shared_turn(views);
    let turn = |(k, model): (usize, &ViewModel)| {
        let weights = weights.fixed_rows::<3>(k * LEN + ROTATION);
        views.len() as f64 * weights.dot(&model.rotation)
    };
    let turns: Vec<f64> = models.iter().enumerate().map(turn).collect();
    let mean = turns.iter().sum::<f64>() / turns.len() as f64;
    let squares: f64 = turns.iter().map(|turn| (turn - mean).powi(2)).sum();
    mean.abs() <= LIKELY * (squares / f64::max(turns.len() as f64 - 1.0, 1.0)).sqrt()
}

/// Returns true if two solutions, with and without a group, show some matches at different places.
fn differs(solver: &Solver, [a, b]: [&Adjustment; 2], group: Group) -> bool {
    let least = NOTICEABLE_PX * solver.pixel;
    if group == Group::Length {
        let nearest = quantile(a.disparities.iter().map(|disparity| disparity.abs()).collect(), NOT_NEAREST);
        let lengths = a.models.iter().zip(&b.models).map(|(a, b)| (a.position.norm() - b.position.norm()).abs());
        return lengths.fold(0.0, f64::max) * nearest > least;
    }
    let distances = solver.expected(a).into_iter().zip(solver.expected(b)).map(|([x, y], [u, v])| (x - u).hypot(y - v));
    quantile(distances.collect(), UNMOVED) > least
}

/// Returns true if a group of an adjustment differs from its nominal values by more than chance.
fn is_significant(solver: &Solver, adjustment: &Adjustment, group: Group) -> bool {
    let combinations = group.combinations(solver.views);
    let Some(covariance) = solver.covariance(adjustment).filter(|_| combinations.nrows() > 0) else { return false };
    let value = &combinations * solver.off(&adjustment.models);
    let covariance = &combinations * covariance * combinations.transpose();
    let count = combinations.nrows() as f64;
    covariance.cholesky().is_some_and(|cholesky| value.dot(&cholesky.solve(&value)) > SIGNIFICANT * count)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::{super::adjustment::nominal, *};

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
                ViewModel {
                    rotation: turn,
                    log_scale: within(0.01),
                    position: nominal(view).position + off,
                    ..ViewModel::NEUTRAL
                }
            })
            .collect();
        let points: Vec<Point> = (0..60)
            .map(|corner| {
                let (ray, disparity) = ([within(0.4), within(0.3)], 0.03 + within(0.02));
                let seen = |model: &ViewModel| model.projection().project(Vector3::new(ray[0], ray[1], 1.0), disparity);
                Point { corner, ray, seen: models.iter().map(|model| Some(seen(model))).collect() }
            })
            .collect();
        let found = Selection::of(&views, &points, 1e-4, None).unwrap().adjustment;
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

    /// A rig whose views differ from the nominal ones by some of the groups, and its matches: with noise of a tenth of a pixel,
    /// an error that neighbours share, as that of a lens, and mismatches.
    fn made_up(random: &mut fastrand::Rng, views: &[View]) -> (Vec<ViewModel>, Vec<Point>) {
        const PIXEL: f64 = 1e-3;
        let within = |random: &mut fastrand::Rng, most: f64| most * (2.0 * random.f64() - 1.0);
        let most = [0.02, 0.01, 0.004, 0.01, 0.0, 0.0, 0.04].map(|most| if random.bool() { most } else { 0.0 });
        let [roll, scale, shift, turn, _, _, direction] = most;
        let models: Vec<ViewModel> = views
            .iter()
            .map(|&view| {
                let across = Vector3::new(0.0, within(random, direction), 0.0);
                ViewModel {
                    rotation: Vector3::new(within(random, turn), 0.0, within(random, roll)),
                    log_scale: within(random, scale),
                    shift: nalgebra::Vector2::new(0.0, within(random, shift)),
                    position: nominal(view).position + across,
                }
            })
            .collect();
        let waves: Vec<[f64; 4]> = models.iter().map(|_| std::array::from_fn(|_| within(random, 9.0))).collect();
        let points = (0..300).map(|corner| {
            let (ray, disparity) = ([within(random, 0.4), within(random, 0.3)], 0.03 + within(random, 0.02));
            let seen = models.iter().zip(&waves).map(|(model, [a, b, c, d])| {
                let [x, y] = model.projection().project(Vector3::new(ray[0], ray[1], 1.0), disparity);
                let shared = [(a * x + b * y).sin(), (c * x + d * y).sin()];
                let tail = if random.f64() < 0.05 { 10.0 } else { 1.0 };
                let error = shared.map(|shared| {
                    let normal: f64 = (0..12).map(|_| random.f64() - 0.5).sum();
                    PIXEL * (0.05 * shared + 0.1 * tail * normal)
                });
                Some([x + error[0], y + error[1]])
            });
            Point { corner, ray, seen: seen.collect() }
        });
        let points = points.collect();
        (models, points)
    }

    /// The share of parameters within two standard deviations, and of groups that are proven but nominal.
    fn coverage(rigs: u64) -> [f64; 2] {
        let views = [View::LEFT, View::RIGHT];
        let (mut inside, mut count, mut invented) = (0, 0, 0);
        for seed in 0..rigs {
            let (models, points) = made_up(&mut fastrand::Rng::with_seed(seed), &views);
            let found = Selection::of(&views, &points, 1e-3, None).unwrap();
            for (k, model) in models.iter().enumerate() {
                let values = found.adjustment.models[k].to_array().into_iter().zip(model.to_array()).zip(found.deviations(k));
                // Those that no constraint holds.
                for (_, ((value, truth), deviation)) in values.enumerate().filter(|(i, _)| [0, 2, 3, 5, 7].contains(i)) {
                    inside += u32::from((value - truth).abs() <= 2.0 * deviation);
                    count += 1;
                }
            }
            let is_nominal = |i: usize| models.iter().zip(&views).all(|(m, &v)| m.to_array()[i] == nominal(v).to_array()[i]);
            let sham = [(Group::Roll, 2), (Group::Scale, 3), (Group::Direction, 7)];
            invented += sham.into_iter().filter(|(group, i)| found.proven.contains(group) && is_nominal(*i)).count();
        }
        [f64::from(inside) / f64::from(count), invented as f64 / rigs as f64]
    }

    #[test]
    fn deviations_are_honest() {
        // A rig takes seconds without optimisation.
        let (rigs, least, most) = if cfg!(debug_assertions) { (2, 0.85, 0.3) } else { (200, 0.95, 0.05) };
        let [inside, invented] = coverage(rigs);
        assert!(inside >= least && invented < most, "{inside} within two deviations, {invented} invented groups a rig");
    }
}
