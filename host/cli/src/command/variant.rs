//! Variants of matching, their measurement, and charts of their errors.

use std::{collections::BTreeSet, time::Instant};

use multiscopic::{
    DisparityMap, Engine, FloatImage, Frames, Method, Metrics, Result,
    evaluation::{CameraSteps, Sparsification},
    images::Layout,
    stereo::{BaselineRefinement, MethodName, confidence_map::ConfidenceMap},
};
use multiscopic_core::{Fusion, SearchSpace, View, Views};

use super::options::Named;
use crate::{
    report::{Chart, ChartLine},
    results::Record,
};

/// A method with the views that it matches and the rule that fuses their costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variant {
    /// The method.
    pub method: MethodName,
    /// The layout of the neighbours at the shortest baseline, if it is not that of `--views N`.
    pub layout: Option<Layout>,
    /// The neighbours.
    pub views: Views,
    /// The fusion rule.
    pub fusion: Fusion,
}

/// Frames with known disparities.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The data set's name.
    pub dataset: &'a str,
    /// The scene's name.
    pub scene: &'a str,
    /// The baseline in camera steps, if it is not the data set's default.
    pub camera_steps: Option<CameraSteps>,
    /// The frames.
    pub frames: &'a Frames,
    /// The true disparities at the default baseline, of which some are known.
    pub truth: &'a FloatImage,
}

/// The estimates of a variant, and their accuracy.
pub struct Measured {
    /// The disparities at the default baseline.
    pub disparities: DisparityMap,
    /// Their confidences.
    pub confidences: ConfidenceMap,
    /// The share of errors among the surest.
    pub curve: Sparsification,
    /// The errors.
    pub record: Record,
}

impl Variant {
    /// The baselines of the views in ascending order, if they are a cross or an array at several.
    pub fn baselines(&self) -> Vec<u8> {
        let reach = |along: fn(View) -> i8| self.views.iter().map(|view| along(view).unsigned_abs()).max().unwrap_or_default();
        let array = (2 * usize::from(reach(View::right)) + 1) * (2 * usize::from(reach(View::down)) + 1);
        let sets = BaselineRefinement::sets(self.views);
        if sets.len() == 1 && self.views.len() + 1 == array {
            return Vec::new();
        }
        let multiples: BTreeSet<u8> = self.views.iter().map(View::multiple).collect();
        if multiples.len() > 1 { multiples.into_iter().collect() } else { Vec::new() }
    }

    /// Matches `subject` with `method`, which is this variant's, and compares the disparities and their confidences with the
    /// truth. Disparities are those at the default baseline.
    pub fn measure(&self, method: &Method, engine: &Engine, subject: &Subject, search: &SearchSpace) -> Result<Measured> {
        let (disparities, confidences, seconds) = self.timed(method, engine, subject.frames, search)?;
        let disparities = match subject.camera_steps {
            Some(steps) => disparities.times(steps.disparity_scale()),
            None => disparities,
        };
        let metrics = Metrics::new(&disparities, subject.truth).expect("some of the truth is known");
        let curve = Sparsification::new(&disparities, &confidences, subject.truth).expect("some of the truth is known");
        let camera_steps = subject.camera_steps.map(CameraSteps::count);
        let confidence = Some(curve.metrics());
        let record = Record { camera_steps, confidence, ..self.record(subject.dataset, subject.scene, metrics, seconds) };
        Ok(Measured { disparities, confidences, curve, record })
    }

    /// Matches frames with `method`, which is this variant's. The time is in seconds.
    pub fn timed(
        &self,
        method: &Method,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
    ) -> Result<(DisparityMap, ConfidenceMap, f64)> {
        let start = Instant::now();
        let (disparities, confidences) = method.disparities_and_confidences(engine, frames, search, &())?;
        Ok((disparities, confidences, start.elapsed().as_secs_f64()))
    }

    /// Returns the record of a measurement in the scene of a data set.
    pub fn record<M>(&self, dataset: &str, scene: &str, metrics: M, seconds: f64) -> Record<M> {
        Record {
            dataset: dataset.into(),
            scene: scene.into(),
            method: self.method.name().into(),
            views: self.views.len(),
            layout: self.layout.map(|layout| layout.to_string()),
            baselines: self.baselines(),
            camera_steps: None,
            fusion: self.fusion.name().into(),
            metrics,
            confidence: None,
            light_field: None,
            seconds: Some(seconds),
        }
    }
}

/// The subjects of the charts: the variants, the records of each in every scene, and what names them.
pub struct Errors<'a> {
    pub variants: &'a [Variant],
    /// Every variant's record, for one scene after the other.
    pub records: &'a [Record],
    /// True if each number of views has the fusion rule that it has by default.
    pub has_default_fusion: bool,
    /// The name of a baseline, in the plural.
    pub baselines: &'a str,
}

impl Errors<'_> {
    /// The charts for which there are several points.
    pub fn charts(&self) -> Vec<Chart> {
        [self.over_views(), self.over_baselines()].into_iter().flatten().collect()
    }

    /// The mean error of the variant with an index, over all scenes.
    fn mean(&self, index: usize) -> f64 {
        let errors = self.records.iter().skip(index).step_by(self.variants.len()).map(|record| record.metrics.avg_err);
        errors.sum::<f64>() / self.scenes() as f64
    }

    fn scenes(&self) -> usize {
        self.records.len() / self.variants.len()
    }

    /// A chart of `lines`, if any of them has two different places.
    fn chart(&self, title: &str, x: &str, lines: Vec<ChartLine>) -> Option<Chart> {
        let extends = |line: &ChartLine| line.points.first().map(|point| point.0) < line.points.last().map(|point| point.0);
        let y = if self.scenes() == 1 { "AvgErr in pixels" } else { "AvgErr in pixels, mean over scenes" };
        lines.iter().any(extends).then(|| Chart { title: title.into(), x: x.into(), y: y.into(), lines })
    }

    /// One line for each method and fusion rule, through the sets of views at a single baseline.
    pub fn over_views(&self) -> Option<Chart> {
        let mut lines = Vec::new();
        for &(method, fusion) in &distinct(self.variants.iter().map(|variant| (variant.method, self.chosen(variant)))) {
            // The rules agree on a single view.
            let same = |variant: &Variant| variant.views.len() == 1 || self.chosen(variant) == fusion;
            let points = self.points(|variant| {
                let is_on_line = variant.baselines().is_empty() && variant.method == method && same(variant);
                is_on_line.then_some(variant.views.len())
            });
            lines.push(ChartLine { name: self.named(method.name(), fusion), points });
        }
        self.chart("Error over the number of views", "views", lines)
    }

    /// One line for each method, fusion rule and set of views at the shortest baseline, through the sets of baselines.
    pub fn over_baselines(&self) -> Option<Chart> {
        let group = |variant: &Variant| (variant.method, self.chosen(variant), BaselineRefinement::shortest(variant.views));
        let groups = distinct(self.variants.iter().map(group));
        let line = |key: &(_, Option<Fusion>, Views)| {
            let longest =
                |variant: &Variant| BaselineRefinement::sets(variant.views).last().map(|views| usize::from(views.multiple()));
            let points = self.points(|variant| longest(variant).filter(|_| group(variant) == *key));
            let (views, plural) = (key.2.len(), if key.2.len() == 1 { "" } else { "s" });
            ChartLine { name: self.named(&format!("{}, {views} view{plural} each", Named::name(&key.0)), key.1), points }
        };
        let lines = groups.iter().map(line).filter(|line| line.points.len() > 1).collect();
        self.chart("Error over the longest baseline", &format!("longest baseline, in {}", self.baselines), lines)
    }

    /// The fusion rule of a variant, unless each number of views has its own.
    fn chosen(&self, variant: &Variant) -> Option<Fusion> {
        (!self.has_default_fusion).then_some(variant.fusion)
    }

    fn named(&self, line: &str, fusion: Option<Fusion>) -> String {
        fusion.map_or_else(|| line.to_owned(), |fusion| format!("{line}, {}", fusion.name()))
    }

    /// The mean errors of the variants for which there is a place, in ascending order.
    fn points(&self, place: impl Fn(&Variant) -> Option<usize>) -> Vec<(f64, f64)> {
        let places = self.variants.iter().enumerate().filter_map(|(index, variant)| Some((place(variant)?, index)));
        let mut places: Vec<(usize, usize)> = places.collect();
        places.sort_unstable();
        places.into_iter().map(|(place, index)| (place as f64, self.mean(index))).collect()
    }
}

/// The share of wrong pixels over the density, the mean over all scenes: a line for each variant, with its optimum. There are
/// records and curves of every variant, for one scene after the other.
pub fn sparsification(variants: &[Variant], records: &[Record], curves: &[Sparsification]) -> Chart {
    let line = |index: usize, name: String, share: &dyn Fn(&Sparsification, f64) -> f64| {
        let of_scenes = || curves.iter().skip(index).step_by(variants.len());
        let mean = |density| of_scenes().map(|curve| share(curve, density)).sum::<f64>() / of_scenes().count() as f64;
        let densities = Sparsification::DENSITIES.iter().filter(|density| (100.0 * **density).round() % 10.0 == 0.0);
        ChartLine { name, points: densities.map(|&density| ((100.0 * density).round(), 100.0 * mean(density))).collect() }
    };
    let lines = records.iter().take(variants.len()).enumerate().flat_map(|(index, record)| {
        let name = record.variant();
        let optimum = format!("{name}, optimum");
        [line(index, name, &Sparsification::wrong_at), line(index, optimum, &Sparsification::least_wrong_at)]
    });
    Chart {
        title: "Wrong pixels among the surest".into(),
        x: "surest pixels in percent".into(),
        y: "pixels off by more than 1 pixel, in percent".into(),
        lines: lines.collect(),
    }
}

/// Each item once, in the order of first appearance.
fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut distinct = Vec::new();
    for item in items {
        if !distinct.contains(&item) {
            distinct.push(item);
        }
    }
    distinct
}
