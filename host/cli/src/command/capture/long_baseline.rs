//! Views at longer baselines, taken where the shortest is not accurate enough.

use multiscopic::{
    DisparityMap, Engine, Frames, Geometry, Method, Result,
    capture::{Accuracy, Bound, Choice, Survey},
    stereo::BaselineRefinement,
};
use multiscopic_core::{SearchSpace, View, Views};

use crate::command::options::SearchOptions;

/// The choice of views at longer baselines.
pub struct LongBaseline {
    /// The accuracy that is asked for.
    pub accuracy: Accuracy,
    /// The range in which the views at the shortest baseline are matched, and the block.
    pub search: SearchOptions,
    /// The engine that matches them.
    pub engine: Engine,
    /// The reach of the stage from the centre, in micrometres.
    pub reach_um: u32,
}

/// The disparities of a capture that longer baselines make more accurate, step by step.
pub struct Refinement<'a> {
    options: &'a LongBaseline,
    search: SearchSpace,
    /// The filtered disparities of the views at the shortest baseline, around which the others are searched.
    prior: DisparityMap,
    survey: Survey,
    choice: Choice,
}

impl LongBaseline {
    /// Matches frames at the shortest baseline, whose geometry this is, and chooses the next.
    pub fn begin(&self, frames: &Frames, geometry: Geometry) -> Result<Refinement<'_>> {
        let search = self.search.search(frames.size(), frames.views(), None, SearchOptions::DEFAULT_RANGE)?;
        let block_size = self.search.block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE);
        let method = Method::block_matching(block_size);
        let short = method.disparities(&self.engine, frames, &search, &())?;
        let survey = Survey::new(&short, geometry, block_size.into())?;
        let choice = self.choose(&survey, &search);
        let prior = match BaselineRefinement::DEFAULT.median {
            Some(median) => median.apply(&short),
            None => short,
        };
        Ok(Refinement { options: self, search, prior, survey, choice })
    }

    fn choose(&self, survey: &Survey, search: &SearchSpace) -> Choice {
        let nearest = at_multiple(search.views(), 1);
        survey.choose(self.accuracy, nearest, BaselineRefinement::DEFAULT.num_disparities, self.reach_um)
    }
}

impl Refinement<'_> {
    /// The views to take next; none if the accuracy is reached or no longer baseline is possible.
    pub fn next_views(&self) -> Views {
        match self.choice.multiple > self.survey.reached.0 {
            true => at_multiple(self.search.views(), self.choice.multiple),
            false => Views::NONE,
        }
    }

    /// The accuracy asked for, and the one that was reached, if that is worse.
    pub fn miss(&self) -> Option<String> {
        let (accuracy, distance_mm) = (self.options.accuracy, self.choice.distance_mm);
        let reached_mm = self.survey.depth_mm(self.survey.reached.1, distance_mm);
        (reached_mm > accuracy.depth_mm).then(|| {
            format!(
                "the accuracy of {accuracy} is not reached: depth has a deviation of {reached_mm:.2} mm at {distance_mm:.0} mm"
            )
        })
    }

    /// Refines the disparities by all views of `frames`, and chooses the next. Returns what was reached, in words, and if the last
    /// views helped: those that did not are better left out, and end the search.
    pub fn refine(&mut self, frames: &Frames) -> Result<(String, bool)> {
        // The prior is filtered already.
        let long = BaselineRefinement { median: None, ..BaselineRefinement::DEFAULT };
        let sets = BaselineRefinement::sets(frames.views());
        let longer = sets.get(1..).unwrap_or_default();
        let refined = long.refine(&self.options.engine, frames, &self.search, longer, (self.prior.clone(), None), &())?;
        // Where the long views found nothing, the prior stays, whose noise says nothing about them.
        let pixels = refined.pixels().iter().zip(self.prior.pixels()).map(|(found, prior)| found.filter(|_| found != prior));
        let found = DisparityMap::new(refined.width(), refined.height(), pixels.collect());
        let share = found.pixels().iter().flatten().count() as f64 / found.pixels().len() as f64;
        let (multiple, before) = self.survey.reached;
        let noise = found.noise(long.block_size.into());
        let mut reached = match noise {
            Some(noise) => format!("reached: {}, on {:.0} % of the pixels", self.noise(noise), 100.0 * share),
            None => "reached: unknown, as the longer baseline refined hardly any pixel".into(),
        };
        let better = noise.filter(|noise| *noise < before);
        if let Some(noise) = better {
            self.survey.reached = (self.choice.multiple, noise);
            self.choice = self.options.choose(&self.survey, &self.search);
        } else {
            reached += ", so these views are left out";
            self.choice = Choice { multiple, bound: Some(Bound::Fit), ..self.choice };
        }
        Ok((reached, better.is_some()))
    }

    /// Describes what the shortest baseline showed.
    pub fn found(&self) -> String {
        let (baseline_mm, [near, far]) = (self.survey.geometry.baseline_mm, self.survey.distances_mm());
        let noise = self.noise(self.survey.noise);
        format!("found at {baseline_mm} mm: distances from {near:.0} to {far:.0} mm, {noise}")
    }

    /// Describes the choice, its reason, and what is expected of it.
    pub fn chosen(&self) -> String {
        let Refinement { survey, choice, options: LongBaseline { accuracy, .. }, .. } = self;
        let length = |multiple: u8| match multiple {
            1 => format!("{} mm", survey.geometry.baseline_mm),
            _ => format!("{} mm, {multiple} baselines", f64::from(multiple) * survey.geometry.baseline_mm),
        };
        let (is_longer, multiple) = (choice.multiple > survey.reached.0, length(choice.multiple));
        match choice.bound {
            None if is_longer => format!(
                "chosen: {multiple}, the shortest that gives {accuracy}; predicted: {}",
                self.noise(survey.predicted_noise(choice.multiple))
            ),
            Some(bound) if is_longer => format!(
                "chosen: {multiple}, although {accuracy} needs more, which {bound} forbids; predicted: {}",
                self.noise(survey.predicted_noise(choice.multiple))
            ),
            None => format!("chosen: to stay at {multiple}, which gives {accuracy}"),
            Some(bound) => format!("chosen: to stay at {multiple}, although {accuracy} needs more, which {bound} forbids"),
        }
    }

    fn noise(&self, noise: f64) -> String {
        let distance = self.choice.distance_mm;
        format!("a noise of {noise:.4} pixels, {:.2} mm at {distance:.0} mm", self.survey.depth_mm(noise, distance))
    }
}

/// The nearest neighbours among `views` in the row and the column of the centre, at `multiple` baselines.
pub fn at_multiple(views: Views, multiple: u8) -> Views {
    View::CROSS.into_iter().filter(|view| views.contains(*view)).filter_map(|view| view.times(multiple)).collect()
}
