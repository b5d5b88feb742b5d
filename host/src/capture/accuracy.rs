//! Choosing the long baseline that gives a depth accuracy.

use std::{fmt, str::FromStr};

use multiscopic_core::{Disparity, View, Views};

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Geometry},
};

/// A depth accuracy at a distance: the standard deviation of depth that is asked for.
///
/// It is written `MM@DISTANCE`, both in millimetres.
///
/// ```
/// use multiscopic::capture::Accuracy;
/// let accuracy: Accuracy = "0.5@600".parse()?;
/// assert_eq!(accuracy, Accuracy { depth_mm: 0.5, distance_mm: 600.0 });
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// The standard deviation of depth in millimetres.
    pub depth_mm: f64,
    /// The distance in millimetres out to which it is asked for.
    pub distance_mm: f64,
}

impl FromStr for Accuracy {
    type Err = Error;

    fn from_str(text: &str) -> Result<Accuracy> {
        let positive = |text: &str| text.trim().parse().ok().filter(|number: &f64| *number > 0.0 && number.is_finite());
        let parts = text.split_once('@').and_then(|(depth, distance)| Some((positive(depth)?, positive(distance)?)));
        let (depth_mm, distance_mm) =
            parts.ok_or_else(|| Error::Usage("it must be an accuracy and a distance in millimetres, as 0.5@600".into()))?;
        Ok(Accuracy { depth_mm, distance_mm })
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} mm at {} mm", self.depth_mm, self.distance_mm)
    }
}

/// The findings of the views at the shortest baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// The camera, with the shortest baseline.
    pub geometry: Geometry,
    /// Width and height of the frames in pixels.
    pub size: [usize; 2],
    /// The disparity of the nearest surfaces, in pixels: one that 2 % of the pixels exceed.
    pub nearest: f64,
    /// The disparity of the farthest surfaces, in pixels: one that 2 % of the pixels fall below.
    pub farthest: f64,
    /// The noise of the disparities in pixels: what [`DisparityMap::noise`] measures, and [`Survey::HIDDEN_NOISE`].
    pub noise: f64,
    /// The longest baseline so far in shortest ones, and the noise that it left in pixels of the shortest.
    pub reached: (u8, f64),
}

impl Survey {
    /// The share of pixels beyond the nearest and beyond the farthest surfaces.
    const OUTLIERS: f64 = 0.02;
    /// The largest range of long disparities that fits around a short one, in standard deviations of its noise, to each side.
    const DEVIATIONS: f64 = 3.0;
    /// The noise in pixels that short baselines hide: where surfaces spread over few disparities, these lock to whole pixels, and
    /// neighbours share the error. Measured, as [`Survey::FALL`] is.
    pub const HIDDEN_NOISE: f64 = 0.05;
    /// The power of the baseline with which the noise falls. It would be 1 if the error of a match were the same number of pixels
    /// at any baseline, but blocks fit worse the more the views differ. Measured on 38 simulated captures of 320x240 and
    /// 640x480 pixels, of 2, 4 and 8 mm and 2 to 14 times as much, 2026-11-30: predictions are off by 11 % in the median, and by at most 27 %.
    pub const FALL: f64 = 0.55;

    /// Surveys the disparities that a match with blocks of `block_size` pixels found.
    ///
    /// # Errors
    /// [`Error::Usage`] if they are too few or none of them has a distance.
    pub fn new(map: &DisparityMap, geometry: Geometry, block_size: usize) -> Result<Survey> {
        let unknown = |what: &str| {
            Error::Usage(format!("the views at the shortest baseline show {what}: check the range of disparities and the light"))
        };
        let mut found: Vec<Disparity> = map.pixels().iter().flatten().copied().filter(|d| geometry.depth(*d).is_some()).collect();
        if found.len() < map.pixels().len() / 4 {
            return Err(unknown("no distances for most pixels"));
        }
        found.sort_unstable();
        let share = |share: f64| f64::from(f32::from(found[(share * (found.len() - 1) as f64) as usize]));
        let noise = map.noise(block_size).ok_or_else(|| unknown("too few surfaces to measure the noise"))?;
        let noise = noise.hypot(Survey::HIDDEN_NOISE);
        let (nearest, farthest) = (share(1.0 - Survey::OUTLIERS), share(Survey::OUTLIERS));
        Ok(Survey { geometry, size: [map.width(), map.height()], nearest, farthest, noise, reached: (1, noise) })
    }

    /// The distance in millimetres at a disparity.
    fn distance_mm(&self, disparity: f64) -> f64 {
        self.geometry.focal_px * self.geometry.baseline_mm / (disparity + self.geometry.doffs)
    }

    /// The nearest and the farthest distance in millimetres.
    pub fn distances_mm(&self) -> [f64; 2] {
        [self.distance_mm(self.nearest), self.distance_mm(self.farthest)]
    }

    /// The standard deviation of depth in millimetres at a distance, at disparities with this noise in pixels of the shortest
    /// baseline: `Z^2 noise / (f B)`.
    pub fn depth_mm(&self, noise: f64, distance_mm: f64) -> f64 {
        distance_mm.powi(2) * noise / (self.geometry.focal_px * self.geometry.baseline_mm)
    }

    /// The noise that views at `multiple` baselines leave, in pixels of the shortest: what was reached so far, which falls with
    /// a [power](Survey::FALL) of the baseline.
    pub fn predicted_noise(&self, multiple: u8) -> f64 {
        let (longest, noise) = self.reached;
        noise * (f64::from(longest) / f64::from(multiple)).powf(Survey::FALL)
    }

    /// Chooses how many baselines away `views`, nearest neighbours, are taken as well: the fewest from the longest so far on
    /// that give `accuracy` out to its distance, or to that of the farthest surfaces if those are nearer.
    ///
    /// The overlap bounds it: with views on both sides, each pixel stays in sight of one of them as long as nothing moves by
    /// more than half the frame; with a view on one side, a quarter of the frame may be lost. So does the search
    /// for `num_disparities` around the short ones, which must contain their noise, and `reach_um`, how far the stage goes from
    /// the centre.
    pub fn choose(&self, accuracy: Accuracy, views: Views, num_disparities: u16, reach_um: u32) -> Choice {
        let distance_mm = accuracy.distance_mm.min(self.distances_mm()[1]);
        let most = self.bounds(views, num_disparities, reach_um).into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let least = self.reached.0;
        let (bound, most) = most.map_or((None, least), |(bound, most)| (Some(bound), (most as u8).max(least)));
        let gives = |multiple: &u8| self.depth_mm(self.predicted_noise(*multiple), distance_mm) <= accuracy.depth_mm;
        let enough = (least..=most).find(gives);
        let multiple = enough.unwrap_or(most);
        Choice { multiple, bound: if enough.is_some() { None } else { bound }, distance_mm }
    }

    /// The most baselines that each bound allows.
    fn bounds(&self, views: Views, num_disparities: u16, reach_um: u32) -> [(Bound, f64); 4] {
        let [width, height] = self.size.map(|side| side as f64);
        let is_two_sided = |view: View| View::new(-view.right(), -view.down()).is_ok_and(|opposite| views.contains(opposite));
        let overlap = views.iter().map(|view| {
            let side = if view.is_horizontal() { width } else { height };
            let share = if is_two_sided(view) { 0.5 } else { 0.25 };
            share * side / self.nearest.abs().max(self.farthest.abs()).max(1e-9)
        });
        [
            (Bound::Overlap, overlap.fold(f64::INFINITY, f64::min)),
            (Bound::Reach, f64::from(reach_um) / (1000.0 * self.geometry.baseline_mm)),
            (Bound::Noise, f64::from(num_disparities / 2) / (Survey::DEVIATIONS * self.noise.max(1e-9))),
            (Bound::Offset, View::MAX_OFFSET.into()),
        ]
    }
}

/// The long baseline that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The long baseline in shortest ones: the longest so far if that suffices or no longer one is possible.
    pub multiple: u8,
    /// The bound that forbids a baseline of that accuracy, if there is no such baseline.
    pub bound: Option<Bound>,
    /// The distance in millimetres for which it was chosen.
    pub distance_mm: f64,
}

/// A bound of the long baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Near surfaces would leave the views.
    Overlap,
    /// The stage does not reach farther.
    Reach,
    /// The short views are too noisy to search around them.
    Noise,
    /// Views are at most [`View::MAX_OFFSET`] baselines away.
    Offset,
    /// A longer baseline left more noise.
    Fit,
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bound::Overlap => f.write_str("the overlap of the nearest surfaces"),
            Bound::Reach => f.write_str("the reach of the stage"),
            Bound::Noise => f.write_str("the noise of the shortest baseline"),
            Bound::Offset => write!(f, "the limit of {} baselines", View::MAX_OFFSET),
            Bound::Fit => f.write_str("the greater noise at a longer one"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEOMETRY: Geometry = Geometry { focal_px: 1000.0, baseline_mm: 5.0, principal_point: [319.5, 239.5], doffs: 0.0 };
    /// From 500 to 1000 mm.
    const SURVEY: Survey =
        Survey { geometry: GEOMETRY, size: [640, 480], nearest: 10.0, farthest: 5.0, noise: 0.1, reached: (1, 0.1) };

    fn choose(survey: Survey, accuracy: &str, views: Views, reach_um: u32) -> (u8, Option<Bound>, f64) {
        let Choice { multiple, bound, distance_mm } = survey.choose(accuracy.parse().unwrap(), views, 8, reach_um);
        (multiple, bound, distance_mm)
    }

    #[test]
    fn the_shortest_baseline_that_suffices_is_chosen() {
        // At 1000 mm, a pixel of 5 mm is 200 mm, and a noise of 0.1 pixels 20 mm.
        assert_eq!(SURVEY.depth_mm(0.1, 1000.0), 20.0);
        assert_eq!(choose(SURVEY, "20@1000", Views::HORIZONTAL, 100_000), (1, None, 1000.0));
        assert_eq!(choose(SURVEY, "19@1000", Views::HORIZONTAL, 100_000), (2, None, 1000.0));
        assert_eq!(choose(SURVEY, "4.95@1000", Views::HORIZONTAL, 100_000), (13, None, 1000.0));
        assert_eq!(choose(SURVEY, "4.95@500", Views::HORIZONTAL, 100_000), (2, None, 500.0));
        // Nothing is farther than 1000 mm.
        assert_eq!(choose(SURVEY, "20@9000", Views::HORIZONTAL, 100_000), (1, None, 1000.0));
    }

    #[test]
    fn what_was_reached_corrects_the_prediction() {
        // Three baselines were predicted to leave 0.055 pixels.
        let more = Survey { reached: (3, 0.05), ..SURVEY };
        assert!((more.predicted_noise(6) - 0.0342).abs() < 0.001);
        assert_eq!(choose(more, "10@1000", Views::HORIZONTAL, 100_000), (3, None, 1000.0));
        assert_eq!(choose(more, "5.5@1000", Views::HORIZONTAL, 100_000), (9, None, 1000.0));
        assert_eq!(choose(more, "5.5@1000", Views::HORIZONTAL, 10_000), (3, Some(Bound::Reach), 1000.0));
    }

    #[test]
    fn each_bound_is_named() {
        let exact = Survey { noise: 0.05, reached: (1, 0.05), ..SURVEY };
        assert_eq!(choose(SURVEY, "0.1@1000", Views::HORIZONTAL, 100_000), (13, Some(Bound::Noise), 1000.0));
        assert_eq!(choose(exact, "0.1@1000", Views::HORIZONTAL, 100_000), (16, Some(Bound::Offset), 1000.0));
        assert_eq!(choose(exact, "0.1@1000", Views::HORIZONTAL, 40_000), (8, Some(Bound::Reach), 1000.0));
        let near = Survey { nearest: 40.0, ..exact };
        assert_eq!(choose(near, "0.1@1000", Views::HORIZONTAL, 100_000), (8, Some(Bound::Overlap), 1000.0));
        assert_eq!(choose(near, "0.1@1000", Views::CROSS, 100_000), (6, Some(Bound::Overlap), 1000.0));
        assert_eq!(choose(near, "0.1@1000", Views::STEREO, 100_000), (4, Some(Bound::Overlap), 1000.0));
        assert_eq!(choose(Survey { nearest: 400.0, ..exact }, "0.1@1000", Views::STEREO, 100_000).0, 1);
    }

    #[test]
    fn what_is_no_accuracy_is_refused() {
        for text in ["", "1", "1@", "@600", "0@600", "1@-600", "1@inf", "one@two"] {
            assert!(text.parse::<Accuracy>().unwrap_err().to_string().contains("as 0.5@600"), "{text}");
        }
    }

    #[test]
    fn a_survey_leaves_outliers_out() {
        let map = DisparityMap::new(
            100,
            100,
            (0..10_000)
                .map(|i| {
                    let d = if i % 97 == 0 { 60.0 } else { 5.0 + 5.0 * f64::from(i % 100) / 99.0 };
                    Disparity::from_bits((64.0 * d) as i16)
                })
                .collect(),
        );
        let survey = Survey::new(&map, GEOMETRY, 11).unwrap();
        assert!((survey.nearest - 10.0).abs() < 0.2 && (survey.farthest - 5.0).abs() < 0.2, "{survey:?}");
        let empty = DisparityMap::new(10, 10, vec![None; 100]);
        assert!(Survey::new(&empty, GEOMETRY, 11).unwrap_err().to_string().contains("no distances"));
    }
}
