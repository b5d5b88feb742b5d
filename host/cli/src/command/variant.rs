//! Variants of matching, and their measurement.

use std::{collections::BTreeSet, time::Instant};

use multiscopic::{
    DisparityMap, Engine, FloatImage, Frames, Method, Metrics, Result,
    evaluation::{CameraSteps, Sparsification},
    images::Layout,
    stereo::{BaselineRefinement, MethodName, confidence_map::ConfidenceMap},
};
use multiscopic_core::{Fusion, SearchSpace, View, Views};

use crate::results::Record;

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
            seconds: Some(seconds),
        }
    }
}
