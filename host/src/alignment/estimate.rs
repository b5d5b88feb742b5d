//! The alignment of all views of a capture.
//!
//! ```text
//! matches = the corners of the centre found in each view, of which those are kept that agree
//! rough   = bundle adjustment of the matches, by what they prove
//! matches = the corners found again in each view as rectified by its rough model, which is more precise
//! model   = bundle adjustment of these, by what they prove
//! common  = the rotation that puts all positions on the image's rows and columns, as far as the nearest point shows it
//! homography of the centre = the common rotation
//! homography of a view     = its own rotation, scale and shift besides, and the image of the plane through the scene as its
//!                            wrong position shows it, since the depth of other points cannot be taken out of one image
//! ```

use std::{collections::BTreeMap, f64::consts::SQRT_2};

use multiscopic_core::{Frame, SearchSpace, View, Views};
use nalgebra::{DVector, Matrix3, Rotation3, Vector3};

use super::{
    adjustment::{LEN, POSITION, Point, ROTATION, SCALE, SHIFT},
    inspection::{Inspection, suspicion},
    selection::{Group, Selection, Tolerance},
    tracking::{Match, Pyramid, RADIUS, corners, find, find_again, keep_consensus},
    view_geometry::{Direction, EpipolarError, Map, Pinhole, ViewModel, common_rotation, common_rotation_with_deviation},
};
use crate::{
    error::{AlignmentError, Error, Result, Warning},
    files::{AlignmentRecord, Residual},
    images::{Frames, Geometry, Picture, Transform},
    lens::Undistortion,
    statistics::median,
};

/// The approximate number of corners.
const CORNERS: usize = 1500;
/// The minimum number of corners that a view shows.
const MIN_POINTS: usize = 30;
/// The focal length if it is not known, in units of the image's larger side: that of a usual camera.
const USUAL_FOCAL: f64 = 1.2;
/// A change of brightness that is not corrected.
const NEGLIGIBLE_GAIN: f64 = 0.01;
/// The turn away from its baseline from which on a view may look swapped, as a share of the image's larger side.
const MIN_TURN_AWAY: f64 = 0.005;
/// The least effect of the rotation between camera and stage that is corrected, in pixels: small ones are not told from
/// errors of the lens.
const MIN_EFFECT_PX: f64 = 0.25;
/// The angle of a calibrated mount that is proven to be wrong, in standard deviations.
const SIGNIFICANT: f64 = 3.0;
/// The largest angle between a view's place and where its name says, in degrees: mounts are straighter.
const MAX_ANGLE_DEG: f64 = 15.0;
/// The standard deviation of the camera's roll against the stage from which on the images do not show it, in degrees.
const MAX_ROLL_DEVIATION_DEG: f64 = 0.5;
/// The least and the most length of a baseline, beside the nominal one.
const LENGTHS: [f64; 2] = [0.5, 2.0];

/// The misalignment of each view of a capture, and the rectification of all of them.
///
/// It is what the images prove: what they show no better than noise is left as it is, so views that are rectified stay so.
///
/// ```no_run
/// use multiscopic::{Alignment, Frames, Rig};
/// use multiscopic_core::{Fusion, SearchConfig};
/// # let folder = std::path::Path::new("rig");
/// let rig = Rig::load(folder)?;
/// let (frames, _) = Frames::load(&rig.images.within(folder))?;
/// let [width, height] = frames.size().map(|side| side as u16);
/// let search = SearchConfig { views: frames.views(), fusion: Fusion::Min, ..SearchConfig::of_size(width, height) }.checked()?;
/// let alignment = Alignment::estimate(&frames, &search, rig.geometry(frames.size()).as_ref())?;
/// let rectified = alignment.compensate(&frames);
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Alignment {
    views: BTreeMap<View, (Residual, Matrix3<f64>)>,
    errors: BTreeMap<View, Vec<EpipolarError>>,
    /// From rays of the centre to the axes along which the views stand.
    common: Rotation3<f64>,
    common_deviation_deg: [f64; 3],
    source: Pinhole,
    target: Pinhole,
    size: [usize; 2],
    proven: Vec<Group>,
    looks_distorted: bool,
}

impl Alignment {
    /// About how many bytes it takes to estimate the alignment of these frames and to rectify them, themselves included: a line
    /// through what the program took for up to five million pixels and four views, rounded up.
    pub fn bytes(frames: &Frames) -> u64 {
        let bytes = 80 + 8 * frames.views().len();
        (frames.width() * frames.height() * bytes) as u64
    }

    /// Checks that the alignment of these frames does not take more than `most_bytes`, if that is limited.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) with what it takes and what there is.
    pub fn check_memory(frames: &Frames, most_bytes: Option<u64>) -> Result<()> {
        Error::check_memory("aligning", Alignment::bytes(frames), most_bytes, "align smaller images")
    }

    /// Estimates the misalignment of every view of `frames`. `search` gives the range of disparities, and `geometry` the
    /// focal length and the principal point: without it, those of a usual camera are taken, and large rotations are found
    /// less precisely.
    ///
    /// # Errors
    /// [`Error::Alignment`](crate::Error::Alignment) if a view has too few corners in common with the centre, or seems to be
    /// another one, or stands far from where its name says.
    pub fn estimate(frames: &Frames, search: &SearchSpace, geometry: Option<&Geometry>) -> Result<Alignment> {
        Alignment::estimate_within(frames, search, geometry, None)
    }

    /// Estimates what is left of the misalignment of a calibrated rig, within a `tolerance`: else as
    /// [`estimate`](Alignment::estimate).
    ///
    /// # Errors
    /// Those of [`estimate`](Alignment::estimate).
    pub fn estimate_within(
        frames: &Frames,
        search: &SearchSpace,
        geometry: Option<&Geometry>,
        tolerance: Option<Tolerance>,
    ) -> Result<Alignment> {
        let size = frames.size();
        let source = geometry.map_or_else(
            || Pinhole {
                focal_px: USUAL_FOCAL * size[0].max(size[1]) as f64,
                principal_point: size.map(|side| (side as f64 - 1.0) / 2.0),
            },
            |geometry| Pinhole { focal_px: geometry.focal_px, principal_point: geometry.principal_point },
        );
        let center = frames.get(Frame::Center).expect("frames always have a centre");
        let corners = corners(center, CORNERS, RADIUS + 1);
        let center = (center, &Pyramid::new(center));
        let views: Vec<View> = frames.views().iter().collect();
        let range = search.min_disparity()..=search.max_disparity();
        let mut matches = Vec::new();
        for &view in &views {
            let neighbor = frames.get(Frame::View(view)).expect("the view is there");
            let mut found = find([center, (neighbor, &Pyramid::new(neighbor))], &corners, view, &range);
            keep_consensus(&corners, &mut found, Direction::of(view), size);
            let count = found.iter().flatten().count();
            if count < MIN_POINTS {
                let usual = "check that it is sharp and shows the scene of the centre, and the range of disparities";
                let hint = suspicion(center.0, neighbor, view).unwrap_or(usual);
                return Err(AlignmentError::FewBlocks { view, count, needed: MIN_POINTS, hint }.into());
            }
            matches.push(found);
        }
        let pixel = 1.0 / source.focal_px;
        let rough_points = points(&source, &corners, &matches);
        let rough = Selection::of(&views, &rough_points, pixel, tolerance).ok_or(AlignmentError::Undetermined)?.adjustment;
        // Turned and scaled like the centre, views show corners more precisely.
        for (k, (&view, found)) in views.iter().zip(&mut matches).enumerate() {
            let model = rough.models[k];
            let map = Map { source, rectified: source, matrix: model.projection().matrix() };
            let neighbor = frames.get(Frame::View(view)).expect("the view is there");
            let moved = ViewModel { position: model.position, ..ViewModel::NEUTRAL }.projection();
            let mut expected = vec![None; corners.len()];
            for (point, &disparity) in rough_points.iter().zip(&rough.disparities) {
                let [x, y] = point.ray;
                expected[point.corner] = Some(source.pixel(moved.project(Vector3::new(x, y, 1.0), disparity)));
            }
            *found = find_again([center.0, neighbor], &corners, view, &expected, |pixel| map.at(pixel));
        }
        let points = points(&source, &corners, &matches);
        let selection = Selection::of(&views, &points, pixel, tolerance).ok_or(AlignmentError::Undetermined)?;
        let adjustment = &selection.adjustment;
        let nominal = |view: View| Vector3::new(view.right().into(), view.down().into(), 0.0);
        let positions: Vec<_> =
            adjustment.models.iter().zip(&views).map(|(model, &view)| (model.position, nominal(view))).collect();
        positions.iter().zip(&views).try_for_each(|(&(position, nominal), &view)| check_place(view, position, nominal))?;
        let nominals: Vec<Vector3<f64>> = positions.iter().map(|(_, nominal)| *nominal).collect();
        let of_common = |models: &[ViewModel]| common_rotation_with_deviation(models, &selection.covariance, &nominals);
        let ([likely, found], deviations) = {
            let (found, deviations) = of_common(&adjustment.models);
            ([of_common(&selection.likely).0, found], deviations)
        };
        let deviations = [0, 1, 2].map(|axis| deviations[axis].hypot(likely[axis] - found[axis]));
        let is_proven = |mount: f64| (0..3).any(|k| found[k].abs() > SIGNIFICANT * deviations[k].hypot(mount.to_degrees()));
        let common = match tolerance {
            Some(Tolerance { mount, .. }) if !is_proven(mount) => Rotation3::identity(),
            _ => significant_rotation(&positions, &source, size, search.max_disparity()),
        };
        // The rectified frames show the same part of the scene: what the centre shows in its middle stays there.
        let middle = size.map(|side| (side as f64 - 1.0) / 2.0);
        let turned = common * source.ray(middle);
        let principal_point = [0, 1].map(|axis| middle[axis] - source.focal_px * turned[axis] / turned.z);
        let target = Pinhole { principal_point, ..source };
        let mut alignment = Alignment {
            views: BTreeMap::new(),
            errors: BTreeMap::new(),
            common,
            common_deviation_deg: deviations,
            source,
            target,
            size,
            proven: selection.proven.clone(),
            looks_distorted: selection.looks_distorted,
        };
        let lengths: Vec<f64> = positions.iter().map(|(position, nominal)| position.norm() / nominal.norm()).collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let plane = plane(&points, &adjustment.disparities);
        for (k, &view) in views.iter().enumerate() {
            let projection = adjustment.models[k].projection();
            // A view that is off its place shows each point off by its disparity. What that is for a plane through the scene
            // goes out with the rest.
            let off = positions[k].0 - common.inverse() * positions[k].1 * mean;
            let matrix = projection.matrix() * (Matrix3::identity() - off * plane.transpose());
            let errors = alignment.errors_in(view, k, &points, &matrix);
            let residual = Residual {
                baseline_scale: lengths[k] / mean,
                baseline_px: (lengths[k] / mean - 1.0) * f64::from(search.max_disparity()),
                ..alignment.residual(&views, k, &selection, &errors, &matches[k])
            };
            alignment.views.insert(view, (residual, matrix));
            let border_px = alignment.border_px(Frame::View(view));
            alignment.views.entry(view).and_modify(|(residual, _)| residual.border_px = border_px);
            alignment.errors.insert(view, errors);
        }
        Ok(alignment)
    }

    /// Inspects the `rectified` frames, given the inspection of the others. Views that looked swapped are, unless they are
    /// turned away from their baselines.
    pub fn inspect(&self, before: &Inspection, rectified: &Frames) -> Inspection {
        let least = MIN_TURN_AWAY * rectified.width().max(rectified.height()) as f64;
        let is_turned_away = |view: &View| {
            let [x, y] = [view.right(), view.down()].map(f64::from);
            let turn = |[right, down, _]: [f64; 3]| (x * down - y * right).to_radians() / x.hypot(y);
            let shift = |[right, down]: [f64; 2]| (x * right + y * down) / x.hypot(y);
            let away = |of: Residual| self.source.focal_px * turn(of.rotation_deg) + shift(of.shift_px);
            self.of(*view).is_some_and(|residual| away(residual) >= least)
        };
        let inspection = Inspection::of(rectified);
        if before.swapped.iter().all(is_turned_away) {
            return inspection;
        }
        Inspection { swapped: before.swapped.clone(), ..inspection }
    }

    /// Warns if the images look as if the lens distorted them.
    pub fn warning(&self) -> Option<Warning> {
        self.looks_distorted.then_some(Warning::Distorted)
    }

    /// The epipolar errors of a view's matches, for the homography of its rays.
    fn errors_in(&self, view: View, k: usize, points: &[Point], matrix: &Matrix3<f64>) -> Vec<EpipolarError> {
        let Direction { across: [ax, ay], .. } = Direction::of(view);
        let across = |ray: Vector3<f64>| self.source.focal_px * (ax * ray.x + ay * ray.y) / ray.z;
        let back = self.common * matrix.try_inverse().unwrap_or_else(Matrix3::identity);
        let error = |point: &Point| {
            let [ray, seen] = [point.ray, point.seen[k]?].map(|[x, y]| Vector3::new(x, y, 1.0));
            Some(EpipolarError {
                pixel: self.source.pixel(point.ray),
                before_px: (across(seen) - across(ray)) / SQRT_2,
                after_px: (across(back * seen) - across(self.common * ray)) / SQRT_2,
            })
        };
        points.iter().filter_map(error).collect()
    }

    /// The misalignment of the view `views[k]`.
    fn residual(
        &self,
        views: &[View],
        k: usize,
        selection: &Selection,
        errors: &[EpipolarError],
        matches: &[Option<Match>],
    ) -> Residual {
        let model = selection.adjustment.models[k];
        let position = self.common * model.position;
        let [x, y] = [views[k].right(), views[k].down()].map(f64::from);
        let deviations = selection.deviations(k);
        // What all baselines share is known less well than how each differs from it.
        let deviation = |weight: &dyn Fn(f64, f64) -> [f64; 2], share: &dyn Fn(f64) -> f64| {
            let mut weights = DVector::zeros(views.len() * LEN);
            for (n, view) in views.iter().enumerate() {
                let [x, y] = [view.right(), view.down()].map(f64::from);
                let own = if n == k { 1.0 } else { 0.0 };
                let of_view = weight(x, y).map(|weight| weight / (x * x + y * y) * (own - share(x * x + y * y)));
                weights.rows_mut(n * LEN + POSITION, 2).copy_from_slice(&of_view);
            }
            selection.deviation(&weights)
        };
        let squares: f64 = views.iter().map(|view| f64::from(view.right()).powi(2) + f64::from(view.down()).powi(2)).sum();
        let is_turned = self.common.angle() > 0.0;
        let median_of = |error: fn(&EpipolarError) -> f64| median(errors.iter().map(error).collect());
        let scale = model.log_scale.exp();
        Residual {
            across_px: SQRT_2 * median_of(|error| error.before_px),
            rotation_deg: [0, 1, 2].map(|axis| model.rotation[axis].to_degrees()),
            rotation_deviation_deg: [0, 1, 2].map(|axis| deviations[ROTATION + axis].to_degrees()),
            scale,
            scale_deviation: scale * deviations[SCALE],
            shift_px: [0, 1].map(|axis| self.source.focal_px * model.shift[axis]),
            shift_deviation_px: [0, 1].map(|axis| self.source.focal_px * deviations[SHIFT + axis]),
            border_px: 0.0,
            baseline_scale: 1.0,
            baseline_scale_deviation: deviation(&|x, y| [x, y], &|_| 1.0 / views.len() as f64),
            baseline_px: 0.0,
            direction_deg: (x * position.y - y * position.x).atan2(x * position.x + y * position.y).to_degrees(),
            direction_deviation_deg: deviation(&|x, y| [-y, x], &|square| if is_turned { square / squares } else { 0.0 })
                .to_degrees(),
            ahead: position.z,
            ahead_deviation: deviations[POSITION + 2],
            gain: median(matches.iter().flatten().map(|found| found.gain).collect()),
            points: errors.len(),
            sampson_px: median_of(|error| error.before_px.abs()),
            rectified_sampson_px: median_of(|error| error.after_px.abs()),
        }
    }

    /// The largest distance by which the rectification moves a corner of a frame, in pixels; 0 if the frame is left as it is.
    pub fn border_px(&self, frame: Frame) -> f64 {
        self.map(frame).filter(|map| !map.is_negligible(self.size)).map_or(0.0, |map| map.border_px(self.size))
    }

    /// A sentence about what the rectification takes out.
    pub fn summary(&self) -> String {
        let frames = std::iter::once(Frame::Center).chain(self.views.keys().copied().map(Frame::View));
        let moved = |frame| Some(self.border_px(frame)).filter(|px| *px > 0.0).map(|px| format!("{frame} {px:.1}"));
        let moved: Vec<String> = frames.filter_map(moved).collect();
        if moved.is_empty() {
            return "the images show no misalignment".into();
        }
        let names: Vec<&str> = self.proven.iter().map(|group| group.name()).collect();
        format!("alignment moves the corners of frames by up to ({}) px, and takes out: {}", moved.join(", "), names.join(", "))
    }

    /// A sentence about what the images do not show, and is left as it is; `None` if they show all.
    pub fn not_shown(&self) -> Option<String> {
        let mut not_shown = Vec::new();
        if !self.proven.contains(&Group::SharedTurn) {
            not_shown
                .push("a shift or turn of all views towards their baselines, which changes all disparities alike".to_owned());
        }
        let [.., roll] = self.common_deviation_deg;
        // It is not finite where nothing shows it.
        if roll.is_nan() || roll >= MAX_ROLL_DEVIATION_DEG {
            not_shown.push(format!("the roll of the camera against the stage (+- {roll:.1} deg)"));
        }
        (!not_shown.is_empty()).then(|| format!("the images do not show {}", not_shown.join(", nor ")))
    }

    /// The views of the capture.
    pub fn views(&self) -> Views {
        self.views.keys().copied().collect()
    }

    /// The epipolar errors of a view's matches; none if the capture does not have the view.
    pub fn epipolar_errors(&self, view: View) -> &[EpipolarError] {
        self.errors.get(&view).map_or(&[], Vec::as_slice)
    }

    /// Returns the findings, for the `rig.toml` of the rectified images.
    pub fn record(&self) -> AlignmentRecord {
        AlignmentRecord {
            common_rotation_deg: self.common_rotation_deg(),
            common_rotation_deviation_deg: self.common_deviation_deg,
            views: self.views.iter().map(|(view, (residual, _))| (view.to_string(), *residual)).collect(),
        }
    }

    /// The misalignment of a view, or `None` if the capture does not have it.
    pub fn of(&self, view: View) -> Option<Residual> {
        self.views.get(&view).map(|(residual, _)| *residual)
    }

    /// The rotation between the camera and the axes along which the views stand, about the axes to the right, down and
    /// ahead, in degrees.
    pub fn common_rotation_deg(&self) -> [f64; 3] {
        self.common.scaled_axis().map(f64::to_degrees).into()
    }

    /// Returns the pixel at which the optical axis of the rectified frames meets them, given the point where it meets the
    /// images.
    pub fn principal_point(&self, [cx, cy]: [f64; 2]) -> [f64; 2] {
        let [[from_x, from_y], [to_x, to_y]] = [self.source, self.target].map(|camera| camera.principal_point);
        [cx + to_x - from_x, cy + to_y - from_y]
    }

    /// The homography from pixels of a rectified frame to those of its image, in rows: the identity if the frame is left as
    /// it is.
    pub fn homography(&self, frame: Frame) -> [[f64; 3]; 3] {
        self.map(frame).map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], |map| map.homography())
    }

    /// The map by which a frame is resampled.
    fn map(&self, frame: Frame) -> Option<Map> {
        let matrix = match frame {
            Frame::Center => Matrix3::identity(),
            Frame::View(view) => self.views.get(&view)?.1,
        };
        Some(Map { source: self.source, rectified: self.target, matrix: matrix * self.common.inverse() })
    }

    /// The transform from the camera of rectified frames to that of the centre.
    pub fn rectified_in_center(&self) -> Transform {
        Transform::rotation(&self.common.inverse())
    }

    /// The frames, rectified and with their brightness corrected. Where views are off their places, they show what is on a
    /// plane through the scene as if they were not; what is before or behind it stays off in proportion.
    pub fn compensate(&self, frames: &Frames) -> Frames {
        let rectified = |frame| {
            let picture = match (frames.color(frame), frames.get(frame)) {
                (Some(color), _) => Picture::Rgb(color.clone()),
                (None, gray) => Picture::Gray(gray.expect("the frame is there").clone()),
            };
            self.rectified(frame, picture, None)
        };
        let center = Frames::of_picture(rectified(Frame::Center));
        frames.views().iter().fold(center, |frames, view| frames.with_picture(view, rectified(Frame::View(view))))
    }

    /// The picture of a frame, rectified and with its brightness corrected. If a lens distorts it, this takes out the
    /// distortion as well, without resampling twice; the alignment is then that of undistorted frames.
    pub fn rectified(&self, frame: Frame, picture: Picture, undistortion: Option<&Undistortion>) -> Picture {
        let gain = match frame {
            Frame::Center => 1.0,
            Frame::View(view) => self.of(view).map_or(1.0, |residual| residual.gain),
        };
        let gain = if (gain - 1.0).abs() > NEGLIGIBLE_GAIN { gain } else { 1.0 };
        let (width, height) = picture.dimensions();
        let map = self.map(frame).filter(|map| !map.is_negligible([width as usize, height as usize]));
        if map.is_none() && gain == 1.0 {
            return match undistortion {
                Some(undistortion) => undistortion.picture(frame, &picture),
                None => picture,
            };
        }
        let place = |pixel: [usize; 2]| {
            let pixel = pixel.map(|at| at as f64);
            let ideal = map.map_or(pixel, |map| map.at(pixel));
            undistortion.map_or(Some(ideal), |undistortion| undistortion.place_of(frame, ideal))
        };
        picture.resampled(place, gain)
    }
}

/// Refuses a view that stands far from where its name says.
fn check_place(view: View, position: Vector3<f64>, nominal: Vector3<f64>) -> Result<()> {
    let angle_deg = position.angle(&nominal).to_degrees();
    let length = position.norm() / nominal.norm();
    if angle_deg <= MAX_ANGLE_DEG && (LENGTHS[0]..=LENGTHS[1]).contains(&length) {
        return Ok(());
    }
    Err(AlignmentError::Misplaced { view, angle_deg, length, allowed_deg: MAX_ANGLE_DEG }.into())
}

/// The rotation from the centre's rays to the axes along which the views stand, as far as it matters to the nearest points.
fn significant_rotation(
    positions: &[(Vector3<f64>, Vector3<f64>)],
    camera: &Pinhole,
    size: [usize; 2],
    max_disparity: i16,
) -> Rotation3<f64> {
    // Across the baseline, a point moves by its disparity times the angle between the baseline and the image's rows, and
    // towards the corners by that times the tilt.
    let effect = |angle: f64| angle * f64::from(max_disparity);
    let radius = f64::hypot(size[0] as f64, size[1] as f64) / 2.0 / camera.focal_px;
    let rotation = common_rotation(positions);
    if effect((rotation * Vector3::z()).xy().norm() * radius) >= MIN_EFFECT_PX {
        return rotation;
    }
    let flat = |position: Vector3<f64>| Vector3::new(position.x, position.y, 0.0);
    let flat: Vec<_> = positions.iter().map(|&(position, nominal)| (flat(position), nominal)).collect();
    let rotation = common_rotation(&flat);
    if effect(rotation.angle()) >= MIN_EFFECT_PX { rotation } else { Rotation3::identity() }
}

/// The corners that some view shows, and where.
pub(super) fn points(camera: &Pinhole, corners: &[[usize; 2]], matches: &[Vec<Option<Match>>]) -> Vec<Point> {
    let ray = |pixel: [f64; 2]| {
        let ray = camera.ray(pixel);
        [ray.x, ray.y]
    };
    let point = |(n, corner): (usize, &[usize; 2])| {
        let seen: Vec<Option<[f64; 2]>> = matches.iter().map(|found| found[n].map(|found| ray(found.at))).collect();
        let is_seen = seen.iter().any(Option::is_some);
        is_seen.then(|| Point { corner: n, ray: ray(corner.map(|at| at as f64)), seen })
    };
    corners.iter().enumerate().filter_map(point).collect()
}

/// The plane that the points are nearest to: the disparity of a ray is its dot product with this.
fn plane(points: &[Point], disparities: &[f64]) -> Vector3<f64> {
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (point, &disparity) in points.iter().zip(disparities) {
        let ray = Vector3::new(point.ray[0], point.ray[1], 1.0);
        matrix += ray * ray.transpose();
        right += ray * disparity;
    }
    matrix.cholesky().map_or_else(Vector3::zeros, |matrix| matrix.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_stand_elsewhere_are_refused() {
        let is_right = |degrees: f64, length: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            check_place(View::RIGHT, Vector3::new(length * cos, length * sin, 0.0), Vector3::x()).is_ok()
        };
        assert!(is_right(0.0, 1.0) && is_right(-14.0, 0.6) && is_right(14.0, 1.9));
        assert!(!is_right(16.0, 1.0) && !is_right(-90.0, 1.0) && !is_right(180.0, 1.0));
        assert!(!is_right(0.0, 0.4) && !is_right(0.0, 2.1));
    }
}
