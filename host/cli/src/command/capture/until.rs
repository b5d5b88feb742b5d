//! Views that are taken one by one, each where it helps most, until depths are as precise as asked for.

use multiscopic::{
    Engine, FloatImage, Frames, Geometry, MatchSetup, RangeSource, Result,
    lens::Undistortion,
    stereo::{
        Estimate, MethodName,
        next_view::{Experience, Goal, Missing, Outlook, Prospect},
    },
};
use multiscopic_core::{View, Views};

use super::long_baseline::at_multiple;
use crate::command::{options::SearchOptions, preparation::mask_unseen};

/// The choice of views until a goal is reached.
pub struct Until {
    /// The precision that is asked for.
    pub goal: Goal,
    /// The most views that are taken.
    pub most_views: usize,
    /// The directions in which views may lie, at any baseline: those of the nearest.
    pub nearest: Views,
    /// The range at the shortest baseline, unless the first views show it.
    pub search: SearchOptions,
    /// The engine that matches them.
    pub engine: Engine,
    /// The shortest baseline and the reach of the stage from the centre, in micrometres.
    pub baseline_um: u32,
    pub reach_um: u32,
}

/// The results of a match.
pub struct Look {
    found: Estimate,
    deviations: FloatImage,
    views: Views,
    /// The share of pixels within the goal.
    pub reached: f64,
    /// The range of disparities, which views at longer baselines keep.
    range: (i16, u16),
}

impl Until {
    /// The first view.
    pub fn first(&self) -> Views {
        let right = self.nearest.contains(View::RIGHT).then_some(View::RIGHT);
        right.or(self.nearest.get(0)).into_iter().collect()
    }

    /// Matches frames of this geometry, whose baseline has a standard deviation, in the range of an earlier look.
    pub fn look(
        &self,
        mut frames: Frames,
        geometry: Geometry,
        of_baseline: f64,
        undistortion: Option<&Undistortion>,
        before: Option<&Look>,
    ) -> Result<Look> {
        let (size, views) = (frames.size(), frames.views());
        let is_given = self.search.min_disparity.is_some() && self.search.num_disparities.is_some();
        let source = if is_given || before.is_some() { RangeSource::Images } else { RangeSource::ImagesAlone };
        let search = |range| self.search.search(size, views, None, before.map_or(range, |before| before.range));
        let setup = MatchSetup::new(&mut frames, source, search)?;
        let range = before.map_or(setup.range, |before| before.range);
        let (method, frames) = setup.suited(MethodName::Net.method(None, views.len())?, frames);
        let mut found = method.estimate(&self.engine, &frames, &setup.search, &())?;
        mask_unseen(undistortion, &mut found.disparities, Some(&mut found.confidences));
        let Estimate { disparities, confidences, baselines } = &found;
        let deviations = method.deviations(&self.engine, &frames, views, disparities, confidences, baselines);
        let deviations = deviations.expect("those of the network are known");
        let deviations = geometry.depth_deviations(&found.disparities, &deviations, of_baseline);
        let reached = self.goal.reached(&deviations);
        Ok(Look { found, deviations, views, reached, range })
    }

    /// The view that helps most, of those that were not `tried`. `None` if the goal is reached or nothing helps.
    pub fn next(&self, look: &Look, tried: Views, experience: Experience) -> Option<Prospect> {
        let is_open = look.reached < self.goal.share && tried.len() < self.most_views;
        is_open.then(|| look.outlook().next(self.goal, self.candidates(tried), experience))?
    }

    /// The places that were not tried, at powers of two of the baseline and as far as the stage reaches. At more baselines, fewer
    /// views would be matched together.
    fn candidates(&self, tried: Views) -> impl Iterator<Item = View> {
        let most = (self.reach_um / self.baseline_um).min(View::MAX_OFFSET as u32) as u8;
        let multiples = (1..=most).filter(move |multiple| multiple.is_power_of_two() || *multiple == most);
        let all = multiples.flat_map(|multiple| at_multiple(self.nearest, multiple).iter().collect::<Vec<_>>());
        all.filter(move |view| !tried.contains(*view))
    }

    /// Describes a look.
    pub fn found(&self, look: &Look) -> String {
        format!("found by {}: {}", listed(look.views), self.within(look.reached))
    }

    /// Describes the choice of a view.
    pub fn chosen(&self, next: &Prospect, look: &Look) -> String {
        let [x, y] = [next.view.right(), next.view.down()].map(|offset| f64::from(offset) * f64::from(self.baseline_um) / 1000.0);
        let reason = if 2.0 * next.hidden > next.share - look.reached { "what no view has seen so far" } else { "precision" };
        format!("chosen: {} at ({x}, {y}) mm, for {reason}; expected: {}", next.view, self.within(next.share))
    }

    /// Describes the end if the goal is not reached: what is left, and why.
    pub fn miss(&self, look: &Look, tried: Views) -> Option<String> {
        if look.reached >= self.goal.share {
            return None;
        }
        let Missing { unseen, unsure, coarse } = look.outlook().missing(self.goal, self.candidates(Views::NONE));
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let cause = if tried.len() >= self.most_views {
            format!("after {} views, the most that may be taken", self.most_views)
        } else {
            "and no other view is expected to help".into()
        };
        Some(format!(
            "the goal of {} is not reached, {cause}: {}; of all pixels, {} show no texture or repeat, {} are hidden from all \
             places within reach, {} would need a longer baseline or less noise",
            self.goal,
            self.within(look.reached),
            percent(unsure),
            percent(unseen),
            percent(coarse)
        ))
    }

    fn within(&self, share: f64) -> String {
        format!("{:.0} % within {} mm", 100.0 * share, self.goal.depth_mm)
    }
}

impl Look {
    fn outlook(&self) -> Outlook<'_> {
        Outlook { found: &self.found, deviations: &self.deviations, views: self.views }
    }
}

/// The views by name.
fn listed(views: Views) -> String {
    views.iter().map(|view| view.to_string()).collect::<Vec<_>>().join(", ")
}
