//! Choosing the view that helps most, where depths are not as precise as asked for.
//!
//! 1. The standard deviation of each pixel's depth tells if it is within the [`Goal`].
//! 2. By the disparities that were found, a candidate sees a pixel, or something nearer hides it. What no view has seen so far is
//!    the other side of an occlusion; what was seen has a confidence, and a baseline that measured it.
//! 3. Of pixels in each such [state](State), a table has how much larger or smaller the deviation was after another view, as
//!    measured on made-up scenes. So each candidate has an expected share of pixels within the goal.
//! 4. The candidate with the greatest share is next. If none adds anything, the pixels that are left tell why.

use std::{fmt, str::FromStr};

use multiscopic_core::{View, Views};

use super::Estimate;
use crate::{
    error::{Error, Result},
    images::{DisparityMap, FloatImage},
};

/// A share of the pixels, and the precision of their depths: the truth is nearer than this length with a probability of 95 %.
///
/// It is written `SHARE % within MM mm`.
///
/// ```
/// use multiscopic::stereo::next_view::Goal;
/// let goal: Goal = "80 % within 2 mm".parse()?;
/// assert_eq!(goal, Goal { share: 0.8, depth_mm: 2.0 });
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The share of all pixels, from 0 to 1.
    pub share: f64,
    /// Two standard deviations of depth in millimetres.
    pub depth_mm: f64,
}

impl Goal {
    /// The share of pixels that are within the goal, of depths with these standard deviations in metres.
    pub fn reached(&self, deviations: &FloatImage) -> f64 {
        let within = deviations.pixels().iter().filter(|&&metres| self.excess(metres) <= 1.0).count();
        within as f64 / deviations.pixels().len() as f64
    }

    /// The ratio of a standard deviation in metres and the largest within the goal.
    fn excess(&self, metres: f32) -> f64 {
        2000.0 * f64::from(metres) / self.depth_mm
    }
}

impl FromStr for Goal {
    type Err = Error;

    fn from_str(text: &str) -> Result<Goal> {
        let number = |text: &str, unit: &str| text.trim().strip_suffix(unit)?.trim().parse::<f64>().ok();
        let parts = text.split_once("within").and_then(|(share, depth)| Some((number(share, "%")?, number(depth, "mm")?)));
        match parts {
            Some((percent, depth_mm)) if 0.0 < percent && percent <= 100.0 && 0.0 < depth_mm && depth_mm.is_finite() => {
                Ok(Goal { share: percent / 100.0, depth_mm })
            }
            _ => Err(Error::Usage("it must be a share of the pixels and a length, as \"80 % within 2 mm\"".into())),
        }
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} % within {} mm", 100.0 * self.share, self.depth_mm)
    }
}

/// The relation of a pixel to a candidate, by what was found so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The candidate does not see it.
    Unseen,
    /// The candidate sees it, and no view did so far.
    Hidden,
    /// It was seen, but its disparity is more probably wrong than right: it has no texture, or repeats.
    Unsure,
    /// It was seen, and its disparity is probably right.
    Doubtful,
    /// Its disparity is [sure](crate::stereo::confidence_map::SURE).
    Sure,
}

impl State {
    /// The number of states.
    pub const COUNT: usize = 5;
}

/// The number of classes of a candidate's baseline beside that at which a pixel was measured: below 3/4 of it, around 1, 2, 4, 8
/// times and above; and one that other views have already, which then are matched together.
pub const GAINS: usize = 7;

/// The class of the ratio of two baselines.
pub fn gain(ratio: f32) -> usize {
    [0.75, 1.5, 3.0, 6.0, 12.0].partition_point(|bound| *bound <= ratio)
}

/// The shares of pixels whose ratio is below those of the table.
pub const SHARES: [f64; 7] = [0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98];

/// The ratios of deviations after and before a view, as binary logarithms in eighths, by state and [gain].
/// `cargo run --release -p multiscopic-tests --example next_view` measures them.
const RATIOS: [[[i8; SHARES.len()]; GAINS]; State::COUNT] = [
    // Unseen
    [
        [-30, -8, -1, 0, 1, 9, 27],
        [-18, -7, -1, 0, 4, 17, 25],
        [-26, -5, 0, 2, 5, 14, 31],
        [-21, -4, 0, 2, 4, 10, 20],
        [-28, -6, 0, 2, 4, 9, 21],
        [-18, -4, 0, 2, 4, 9, 23],
        [-26, -8, -1, 0, 3, 11, 23],
    ],
    // Hidden
    [
        [-76, -39, -14, -7, -3, 1, 9],
        [-47, -47, -36, -6, 0, 29, 29],
        [-55, -39, -25, -17, -9, 0, 10],
        [-77, -44, -26, -16, -7, 3, 13],
        [-75, -49, -30, -16, -3, 6, 18],
        [-71, -57, -38, -24, -7, 2, 10],
        [-66, -41, -27, -17, -8, 2, 15],
    ],
    // Unsure
    [
        [-28, -12, -3, 1, 5, 16, 30],
        [-16, -10, -6, -3, 0, 3, 11],
        [-36, -18, -6, 0, 3, 11, 25],
        [-34, -19, -9, -1, 1, 7, 15],
        [-67, -28, -13, -3, 1, 5, 14],
        [-38, -25, -7, -1, 1, 5, 14],
        [-44, -26, -12, -5, 0, 8, 22],
    ],
    // Doubtful
    [
        [-31, -13, -3, 0, 2, 8, 21],
        [-27, -14, -6, -2, 1, 6, 16],
        [-30, -15, -5, 0, 4, 13, 24],
        [-35, -21, -8, -1, 3, 10, 20],
        [-34, -20, -8, 0, 4, 9, 20],
        [-41, -25, -12, -2, 3, 10, 22],
        [-35, -18, -8, -3, 0, 7, 21],
    ],
    // Sure
    [
        [-9, -3, -1, 0, 1, 6, 17],
        [-19, -10, -4, 0, 2, 8, 18],
        [-18, -11, -5, -1, 1, 8, 26],
        [-27, -19, -12, -6, 0, 5, 17],
        [-31, -23, -14, -5, 1, 7, 17],
        [-38, -30, -20, -9, 1, 9, 23],
        [-17, -8, -3, -1, 1, 5, 13],
    ],
];

/// The expectation of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// The candidate.
    pub view: View,
    /// The expected share of pixels within the goal, from 0 to 1.
    pub share: f64,
    /// The part of it that no view has seen so far.
    pub hidden: f64,
}

/// The gains that were expected of views, and those that came out: what some scenes have, such as gloss, no table knows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Experience {
    expected: f64,
    came: f64,
}

impl Experience {
    /// The gain as which the table counts.
    const PRIOR: f64 = 0.1;

    /// With another view, of which one gain in the share of pixels was expected, and another one came.
    pub fn with(self, expected: f64, came: f64) -> Experience {
        Experience { expected: self.expected + expected, came: self.came + came.max(0.0) }
    }

    /// The factor of expected gains, from 0 to 1.
    fn trust(self) -> f64 {
        ((Experience::PRIOR + self.came) / (Experience::PRIOR + self.expected)).min(1.0)
    }
}

/// The shares of all pixels that are not within the goal, by the reason.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Missing {
    /// No view has seen them, nor would a candidate.
    pub unseen: f64,
    /// Their disparities are more probably wrong than right, or there are none.
    pub unsure: f64,
    /// They are measured, but not precisely enough.
    pub coarse: f64,
}

/// The results of a match of the views that were taken, for the choice of the next.
#[derive(Clone, Copy, Debug)]
pub struct Outlook<'a> {
    /// The disparities, how confident they are, and the baselines that measured them.
    pub found: &'a Estimate,
    /// The standard deviations of the depths in metres.
    pub deviations: &'a FloatImage,
    /// The views that were matched.
    pub views: Views,
}

/// The most times farther than all views so far that the next may be, since a longer baseline is less predictable the longer it
/// is.
const MOST_GROWTH: u8 = 4;

/// The share of pixels that another view must be expected to bring within the goal.
const LEAST_GAIN: f64 = 0.01;

impl Outlook<'_> {
    /// The candidate with the greatest expected share of pixels within the goal, corrected by what came of earlier ones,
    /// among those that are at most four times as far as all views so far. `None` if none is expected to help.
    pub fn next(&self, goal: Goal, candidates: impl IntoIterator<Item = View>, experience: Experience) -> Option<Prospect> {
        let reached = goal.reached(self.deviations);
        let most = MOST_GROWTH * self.views.iter().map(View::multiple).max().unwrap_or(1);
        let candidates = candidates.into_iter().filter(|view| view.multiple() <= most);
        let best = self.prospects(goal, candidates).into_iter().max_by(|a, b| a.share.total_cmp(&b.share))?;
        let corrected = |share: f64| experience.trust() * share;
        let share = reached + corrected(best.share - reached);
        (share >= reached + LEAST_GAIN).then_some(Prospect { share, hidden: corrected(best.hidden), ..best })
    }

    /// The expectations of candidates.
    pub fn prospects(&self, goal: Goal, candidates: impl IntoIterator<Item = View>) -> Vec<Prospect> {
        let seen = self.seen();
        let pixels = seen.len() as f64;
        let prospect = |view: View| {
            let (mut share, mut hidden) = (0.0, 0.0);
            for (at, (state, gain)) in self.states(view, &seen).enumerate() {
                let excess = goal.excess(self.deviations.pixels()[at]);
                let within = if excess.is_finite() { share_below(&RATIOS[state as usize][gain], -excess.log2()) } else { 0.0 };
                share += within / pixels;
                if state == State::Hidden {
                    hidden += within / pixels;
                }
            }
            Prospect { view, share, hidden }
        };
        candidates.into_iter().map(prospect).collect()
    }

    /// The shares of pixels that are not within the goal.
    pub fn missing(&self, goal: Goal, candidates: impl IntoIterator<Item = View>) -> Missing {
        let seen = self.seen_by(self.views.iter().chain(candidates));
        let one = 1.0 / seen.len() as f64;
        let mut missing = Missing::default();
        for (at, metres) in self.deviations.pixels().iter().enumerate().filter(|(_, metres)| goal.excess(**metres) > 1.0) {
            match self.found.confidences.pixels()[at] {
                _ if metres.is_finite() && !seen[at] => missing.unseen += one,
                ..128 => missing.unsure += one,
                128.. => missing.coarse += one,
            }
        }
        missing
    }

    /// True of the pixels that one of the matched views sees.
    pub fn seen(&self) -> Vec<bool> {
        self.seen_by(self.views.iter())
    }

    fn seen_by(&self, views: impl Iterator<Item = View>) -> Vec<bool> {
        let mut seen = vec![false; self.found.disparities.pixels().len()];
        for view in views {
            seen.iter_mut().zip(seen_from(&self.found.disparities, view)).for_each(|(seen, from_here)| *seen |= from_here);
        }
        seen
    }

    /// The state of each pixel for a candidate, and the class of the candidate's [gain], of which pixels are
    /// [seen](Outlook::seen) so far.
    pub fn states<'s>(&'s self, candidate: View, seen: &'s [bool]) -> impl Iterator<Item = (State, usize)> + 's {
        let distance = |view: View| view.right().unsigned_abs().max(view.down().unsigned_abs());
        let joins = self.views.iter().any(|view| distance(view) == distance(candidate));
        let reach = f32::from(distance(candidate));
        let from_there = seen_from(&self.found.disparities, candidate);
        from_there.into_iter().enumerate().map(move |(at, sees)| {
            let state = match self.found.confidences.pixels()[at] {
                _ if !sees => State::Unseen,
                _ if !seen[at] => State::Hidden,
                ..128 => State::Unsure,
                128..230 => State::Doubtful,
                230.. => State::Sure,
            };
            (state, if joins { GAINS - 1 } else { gain(reach / self.found.baselines.pixels()[at]) })
        })
    }
}

/// The difference of disparity in pixels from which on a surface hides another.
const IN_FRONT: f32 = 1.0;

/// True of the pixels that a view shows, by their disparities: their matches lie inside, and nothing is in front.
fn seen_from(map: &DisparityMap, view: View) -> Vec<bool> {
    let (width, height) = (map.width(), map.height());
    let place = |at: usize| {
        let d = f32::from(map.pixels()[at]?);
        let along = |at: usize, offset: i8, size: usize| {
            let place = (at as f32 - f32::from(offset) * d).round();
            (0.0..size as f32).contains(&place).then_some(place as usize)
        };
        Some((along(at / width, view.down(), height)? * width + along(at % width, view.right(), width)?, d))
    };
    let mut nearest = vec![f32::NEG_INFINITY; width * height];
    for (place, d) in (0..width * height).filter_map(place) {
        nearest[place] = nearest[place].max(d);
    }
    (0..width * height).map(|at| place(at).is_some_and(|(place, d)| nearest[place] < d + IN_FRONT)).collect()
}

/// The share of ratios that are at most `most`, between those of a row of [`RATIOS`] by a straight line.
fn share_below(row: &[i8; SHARES.len()], most: f64) -> f64 {
    let ratio = |k: usize| f64::from(row[k]) / 8.0;
    match row.iter().rposition(|ratio| f64::from(*ratio) / 8.0 <= most) {
        None => 0.0,
        Some(k) if k + 1 == SHARES.len() => 1.0,
        Some(k) => SHARES[k] + (SHARES[k + 1] - SHARES[k]) * (most - ratio(k)) / (ratio(k + 1) - ratio(k)),
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Disparity;

    use super::*;
    use crate::images::Raster;

    const WIDTH: usize = 60;

    /// An object at disparity 10 in columns 20 to 29, before a background at 2, as sure as can be but for what the right view
    /// does not see.
    fn found() -> Estimate {
        let column = |at: usize| at % WIDTH;
        let disparities = (0..WIDTH * 4).map(|at| Disparity::whole(if (20..30).contains(&column(at)) { 10 } else { 2 }));
        let confidences = (0..WIDTH * 4).map(|at| if (12..20).contains(&column(at)) { 60 } else { 250 });
        Estimate {
            disparities: DisparityMap::new(WIDTH, 4, disparities.collect()),
            confidences: Raster::new(WIDTH, 4, confidences.collect()),
            baselines: Raster::filled(WIDTH, 4, 1.0),
        }
    }

    fn columns(seen: &[bool]) -> Vec<usize> {
        (0..WIDTH).filter(|u| !seen[WIDTH + u]).collect()
    }

    #[test]
    fn a_view_does_not_see_what_is_hidden_or_outside() {
        let map = found().disparities;
        // The object moves 8 columns against the background, and 2 leave the image.
        assert_eq!(columns(&seen_from(&map, View::RIGHT)), [0, 1].into_iter().chain(12..20).collect::<Vec<_>>());
        assert_eq!(columns(&seen_from(&map, View::LEFT)), (30..38).chain([58, 59]).collect::<Vec<_>>());
        assert_eq!(seen_from(&map, View::TOP).iter().filter(|seen| **seen).count(), (WIDTH - 10) * 2);
    }

    #[test]
    fn the_other_side_of_an_occlusion_is_chosen() {
        let found = found();
        // What is hidden is a metre off, and the rest twice as precise as is asked for.
        let deviations = found.confidences.map(|confidence| if *confidence < 128 { 1.0 } else { 0.0005 });
        let outlook = Outlook { found: &found, deviations: &deviations, views: Views::NONE.with(View::RIGHT) };
        let goal: Goal = "95 % within 2 mm".parse().unwrap();
        assert!((goal.reached(&deviations) - 52.0 / 60.0).abs() < 1e-9);
        let states: Vec<(State, usize)> = outlook.states(View::LEFT, &outlook.seen()).collect();
        assert_eq!([10, 15, 25, 35].map(|u| states[u].0), [State::Sure, State::Hidden, State::Sure, State::Unseen]);
        let next = View::RIGHT.times(2).unwrap();
        let [left, right] = outlook.prospects(goal, [View::LEFT, next])[..] else { panic!("two candidates") };
        assert!(left.hidden > 0.0 && right.hidden == 0.0, "{left:?}, {right:?}");
        let missing = outlook.missing(goal, []);
        assert!((missing.unseen - 8.0 / 60.0).abs() < 1e-9 && missing.coarse == 0.0, "{missing:?}");
        assert!((outlook.missing(goal, [View::LEFT]).unsure - 8.0 / 60.0).abs() < 1e-9);
    }

    #[test]
    fn shares_lie_between_those_that_were_measured() {
        let row = [-16, -8, 0, 8, 16, 24, 32];
        for (most, expected) in [(-2.1, 0.0), (-2.0, 0.02), (-1.0, 0.1), (-0.5, 0.2), (1.0, 0.5), (4.0, 1.0), (9.0, 1.0)] {
            assert!((share_below(&row, most) - expected).abs() < 1e-9, "{most}");
        }
        // A jump.
        assert_eq!([-0.1, 0.0].map(|most| share_below(&[0; 7], most)), [0.0, 1.0]);
        assert_eq!([0.7, 1.0, 2.0, 11.0, 16.0].map(gain), [0, 1, 2, 4, 5]);
    }

    #[test]
    fn what_is_no_goal_is_refused() {
        for text in ["", "80", "80 % 2 mm", "0 % within 2 mm", "101 % within 2 mm", "80 % within 0 mm", "80 within 2 mm"] {
            assert!(text.parse::<Goal>().unwrap_err().to_string().contains("as \"80 % within 2 mm\""), "{text}");
        }
        assert_eq!("80% within 2mm".parse::<Goal>().unwrap().to_string(), "80 % within 2 mm");
    }
}
