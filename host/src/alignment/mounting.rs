//! The mounting of a camera on its stage, from what it sees while the stage moves it.

use multiscopic_core::{Frame, View};
use nalgebra::Vector3;

use super::{
    adjustment::adjust_moved,
    estimate::points,
    tracking::{Match, Pyramid, RADIUS, corners, find, find_again, keep_consensus},
    view_geometry::{Direction, Pinhole, common_rotation_with_deviation},
};
use crate::{
    error::{MountingError, Result},
    images::{Frames, Geometry},
    lens::Mount,
    statistics::median,
};

/// The approximate number of corners.
const CORNERS: usize = 1500;
/// The minimum number of corners that a view shows.
const MIN_POINTS: usize = 60;
/// The least median parallax of the longest moves, in pixels.
const MIN_PARALLAX_PX: f64 = 5.0;
/// The largest standard deviation of an angle, in degrees.
const MAX_DEVIATION_DEG: f64 = 0.25;
/// The extent of the image's middle, as a share of its width to each side.
const MIDDLE: f64 = 0.1;
/// The most by which the distances of points in the middle of the image may differ, as a share.
const MAX_DEPTH_SPREAD: f64 = 0.05;

/// The rotation of a camera against the stage that moves it, and the distance of the scene.
#[derive(Clone, Debug)]
pub struct Mounting {
    /// The rotation from the stage's axes to the camera's: an axis, to the right, down and ahead, times an angle in degrees.
    pub rotation_deg: [f64; 3],
    /// Standard deviations of the angles.
    pub deviation_deg: [f64; 3],
    /// The number of corners that were found in some view.
    pub points: usize,
    /// The median parallax of the longest moves, in pixels.
    pub parallax_px: f64,
    /// The root mean square error of the matches, in pixels, without outliers.
    pub noise_px: f64,
    /// The parallax of one step in the middle of the image, in pixels, for each point there.
    middle_px: Vec<f64>,
    step_mm: f64,
}

impl Mounting {
    /// Estimates the mount from frames that were taken one and more steps to all sides. `geometry` has the step as its
    /// baseline. The second and the first angle are in proportion to its focal length.
    ///
    /// # Errors
    /// [`Error::Mounting`](crate::Error::Mounting) if the images do not determine the mount.
    pub fn estimate(frames: &Frames, geometry: &Geometry) -> Result<Mounting> {
        let (size, source) = (frames.size(), Pinhole { focal_px: geometry.focal_px, principal_point: geometry.principal_point });
        let center = frames.get(Frame::Center).expect("frames always have a centre");
        let corners = corners(center, CORNERS, RADIUS + 1);
        let center = (center, &Pyramid::new(center));
        let views: Vec<View> = frames.views().iter().collect();
        let multiple = |view: View| f64::from(view.right()).hypot(view.down().into());
        let longest = views.iter().map(|&view| multiple(view)).fold(1.0, f64::max);
        // The longest move shifts no point by more than a quarter of the image.
        let most = (size[0] as f64 / 4.0 / longest) as i16;
        let mut matches = Vec::new();
        for &view in &views {
            let neighbor = frames.get(Frame::View(view)).expect("the view is there");
            // Parallax of the wrong sign shows that an axis is reversed.
            let mut found = find([center, (neighbor, &Pyramid::new(neighbor))], &corners, view, &(-most..=most));
            keep_consensus(&corners, &mut found, Direction::of(view), size);
            let expected: Vec<_> = found.iter().map(|found| found.map(|found| found.at)).collect();
            found = find_again([center.0, neighbor], &corners, view, &expected, |pixel| pixel);
            let [x, y] = [view.right(), view.down()].map(f64::from);
            let parallax = |(corner, found): (&[usize; 2], &Option<Match>)| {
                let [du, dv] = [0, 1].map(|axis| Some(found.as_ref()?.at[axis] - corner[axis] as f64));
                Some(-(x * du? + y * dv?) / multiple(view).powi(2))
            };
            let parallaxes: Vec<f64> = corners.iter().zip(&found).filter_map(parallax).collect();
            let count = parallaxes.len();
            if count < MIN_POINTS {
                return Err(MountingError::FewBlocks { view, count, needed: MIN_POINTS }.into());
            }
            if median(parallaxes) < 0.0 {
                return Err(MountingError::Reversed { view }.into());
            }
            matches.push(found);
        }
        let points = points(&source, &corners, &matches);
        let (adjustment, covariance) = adjust_moved(&views, &points, 1.0 / source.focal_px).ok_or(MountingError::Undetermined)?;
        let nominal: Vec<Vector3<f64>> =
            views.iter().map(|view| Vector3::new(view.right().into(), view.down().into(), 0.0)).collect();
        // How long a step is in the adjustment's unit.
        let lengths = adjustment.models.iter().zip(&nominal).map(|(model, nominal)| model.position.norm() / nominal.norm());
        let unit = lengths.sum::<f64>() / views.len() as f64;
        let parallax = |disparity: &f64| disparity * unit * source.focal_px;
        let parallax_px = longest * median(adjustment.disparities.iter().map(parallax).collect());
        if parallax_px < MIN_PARALLAX_PX {
            return Err(MountingError::SmallParallax { parallax_px, needed_px: MIN_PARALLAX_PX }.into());
        }
        let (rotation_deg, deviation_deg) = common_rotation_with_deviation(&adjustment.models, &covariance, &nominal);
        let worst = deviation_deg.into_iter().fold(0.0, f64::max);
        if worst.is_nan() || worst > MAX_DEVIATION_DEG {
            return Err(MountingError::Uncertain { deviation_deg: worst, allowed_deg: MAX_DEVIATION_DEG }.into());
        }
        let in_middle = |ray: [f64; 2]| ray.iter().all(|at| (at * source.focal_px).abs() < MIDDLE * size[0] as f64);
        let middle = points.iter().zip(&adjustment.disparities).filter(|(point, _)| in_middle(point.ray));
        Ok(Mounting {
            rotation_deg,
            deviation_deg,
            points: points.len(),
            parallax_px,
            noise_px: adjustment.noise * source.focal_px,
            middle_px: middle.map(|(_, disparity)| parallax(disparity)).collect(),
            step_mm: geometry.baseline_mm,
        })
    }

    /// The focal length in pixels and its standard deviation, if what the middle of the image shows is at a known distance from
    /// the camera.
    ///
    /// # Errors
    /// [`Error::Mounting`](crate::Error::Mounting) if the points there are few or at different distances.
    pub fn focal_px(&self, distance_mm: f64) -> Result<[f64; 2]> {
        let count = self.middle_px.len();
        let middle = median(self.middle_px.clone());
        let spread = 1.4826 * median(self.middle_px.iter().map(|parallax| (parallax / middle - 1.0).abs()).collect());
        if count < 10 || spread > MAX_DEPTH_SPREAD {
            return Err(MountingError::NoFlatTarget { count, spread: if spread.is_nan() { 0.0 } else { spread } }.into());
        }
        let focal_px = middle * distance_mm / self.step_mm;
        Ok([focal_px, focal_px * spread / (count as f64).sqrt()])
    }

    /// The distance in millimetres to what the middle of the image shows, for a focal length in pixels. NaN if it shows no
    /// texture.
    pub fn distance_mm(&self, focal_px: f64) -> f64 {
        focal_px * self.step_mm / median(self.middle_px.clone())
    }

    /// The mount, with a focal length in pixels.
    pub fn mount(&self, focal_px: f64) -> Mount {
        Mount { rotation_deg: self.rotation_deg, rotation_deviation_deg: Some(self.deviation_deg), focal_px: Some(focal_px) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mounting with these parallaxes in the middle of the image, for a step of 10 mm.
    fn mounting(middle_px: Vec<f64>) -> Mounting {
        let angles = [0.0; 3];
        Mounting {
            rotation_deg: angles,
            deviation_deg: angles,
            points: 100,
            parallax_px: 20.0,
            noise_px: 0.1,
            middle_px,
            step_mm: 10.0,
        }
    }

    #[test]
    fn a_flat_target_at_a_known_distance_gives_the_focal_length() {
        // 900 pixels and 450 mm: a parallax of 20 pixels, up to 1 % off.
        let middle: Vec<f64> = (0..101).map(|k| 20.0 * (1.0 + 0.01 * (f64::from(k) - 50.0) / 50.0)).collect();
        let [focal, deviation] = mounting(middle).focal_px(450.0).unwrap();
        assert!((focal - 900.0).abs() < 1e-9, "{focal}");
        // Half of them are up to 0.5 % off.
        assert!((deviation - 900.0 * 1.4826 * 0.005 / 101.0_f64.sqrt()).abs() < 1e-3, "{deviation}");
        let distance = mounting(vec![20.0; 20]).distance_mm(900.0);
        assert!((distance - 450.0).abs() < 1e-9, "{distance}");
    }

    #[test]
    fn a_target_that_is_not_flat_or_without_texture_is_refused() {
        let slanted = (0..101).map(|k| 10.0 + 0.2 * f64::from(k)).collect();
        for (middle, words) in [(slanted, "101 points there"), (vec![20.0; 9], "9 points there"), (Vec::new(), "0 points there")]
        {
            let message = mounting(middle).focal_px(450.0).unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("flat target"), "{message}");
        }
    }
}
