//! Matches of sweeps.

use std::time::Instant;

use image::GrayImage;
use multiscopic::{
    DisparityMap, Engine, Error, Result,
    stereo::{Estimate, Method, SweepFrames, confidence_map, dense_sweep, growing_sweep},
};
use multiscopic_core::{Frame, SweepOffset, SweepParams};

use super::{Match, Matched, Outputs, Summary};
use crate::{
    command::{
        batch::RunSettings,
        options::{LoadedSweep, Source},
        preparation::{mask_unseen, prepare, say_if_much},
        terminal::Watch,
    },
    report::{SweepStep, ViewedMap},
};

/// The options that a sweep obeys.
const OBEYED: [&str; 33] = [
    "auto_range",
    "baseline_mm",
    "bits",
    "colormap",
    "confidence",
    "depth",
    "depth_png",
    "depth_range",
    "doffs",
    "edges",
    "focal_px",
    "frame",
    "hand_eye",
    "json",
    "lens",
    "mcap",
    "min_confidence",
    "min_disparity",
    "no_inspection",
    "num_disparities",
    "output",
    "ply",
    "ply_ascii",
    "png",
    "png_colorbar",
    "preview",
    "principal_point",
    "raw16",
    "region",
    "report",
    "rerun",
    "rig",
    "shrink",
];

/// The most steps that a page shows.
const MOST_STEPS: usize = 16;

/// The steps of a sweep that a page shows, evenly spread over its frames.
fn steps(params: &SweepParams, center: Option<&GrayImage>, images: &[(SweepOffset, &GrayImage)]) -> Vec<SweepStep> {
    let (Some(center), count) = (center, images.len().min(MOST_STEPS)) else { return Vec::new() };
    let after: Vec<usize> = (1..=count).map(|step| step * images.len() / count).collect();
    let (_, growth) = growing_sweep(params, center, images, &after);
    let step = |(frames, disparities): (usize, DisparityMap)| {
        let (offset, image) = images[frames - 1];
        let place = f64::from(offset.to_bits()) / f64::from(SweepOffset::STEPS);
        SweepStep { frames, place, image: image.clone(), disparities }
    };
    after.into_iter().zip(growth).map(step).collect()
}

impl Match {
    /// Matches the frames of a sweep, and writes the outputs together.
    pub(super) fn matched_sweep(
        &self,
        mut source: Source,
        mut loaded: LoadedSweep,
        outputs: &Outputs,
        engine: &Engine,
        settings: &RunSettings,
    ) -> Result<(Summary, DisparityMap)> {
        if let Some(option) = settings.parameters.keys().find(|option| !OBEYED.contains(&&***option)) {
            return Err(Error::Usage(format!(
                "--{} has no effect on the frames of a sweep: leave it out",
                option.replace('_', "-")
            )));
        }
        let whole = self.geometry.geometry(source.rig.as_ref(), source.lens.as_ref(), &loaded.swept.frames)?;
        let truth = self.check_outputs(&source, outputs)?;
        let mut warnings = Vec::new();
        if let Some(factor) = self.shrink {
            source = source.shrunk(factor);
            loaded = source.load_sweep()?.expect("it is a sweep still");
        }
        let (geometry, preparation, params) = loop {
            let LoadedSweep { swept, undistortion, .. } = &mut loaded;
            let frames = &mut swept.frames;
            let mut geometry = whole.map(|geometry| geometry.shrunk(source.shrink()));
            let (size, views) = (frames.size(), frames.views());
            self.limits.check(size)?;
            let search = |range| self.matching.search(size, views, range);
            let ways = (&self.preparation, self.matching.search.range_source(&self.preparation));
            let preparation = prepare(ways, &source, undistortion.as_ref(), frames, &mut geometry, &self.engine.memory, search)?;
            let count = preparation.search.num_disparities();
            let factor = count.div_ceil(SweepParams::MAX_DISPARITIES) as u32;
            if factor > 1 && self.shrink.is_none() && self.matching.search.num_disparities.is_none() {
                warnings.push(format!(
                    "the images were shrunk by {factor}, since they show {count} disparities and a sweep has {}; disparities are in \
                     pixels of the smaller images (--shrink)",
                    SweepParams::MAX_DISPARITIES
                ));
                source = source.shrunk(factor);
                loaded = source.load_sweep()?.expect("it is a sweep still");
                continue;
            }
            let params = swept.params(preparation.search);
            let params =
                params.map_err(|error| Error::Usage(format!("{error}: give a smaller --num-disparities, or --shrink")))?;
            break (geometry, preparation, params);
        };
        let LoadedSweep { swept: SweepFrames { frames, placed, .. }, center, undistortion } = loaded;
        let frame_tree = source.frame_tree(undistortion.as_ref(), None, outputs.hand_eye.as_deref())?;
        let frame = outputs.frame(&frame_tree)?;
        let center = outputs.has_center().then(|| match &undistortion {
            Some(undistortion) => undistortion.picture(Frame::Center, &center),
            None => center,
        });
        say_if_much("matching", 4 * params.memory_words() as u64);
        let start = Instant::now();
        let images: Vec<_> = placed.iter().map(|(offset, image)| (*offset, image)).collect();
        let watch = Watch::new();
        let found = dense_sweep(engine, &Method::net(), &frames, &params, &images, &watch)?;
        watch.finish();
        let Estimate { mut disparities, mut confidences, .. } = found;
        let seconds = start.elapsed().as_secs_f64();
        if let Some(least) = self.matching.min_confidence() {
            confidence_map::filter_by_confidence(&mut disparities, &mut confidences, least);
        }
        mask_unseen(undistortion.as_ref(), &mut disparities, Some(&mut confidences));
        self.limits.apply(&mut disparities, Some(&mut confidences), geometry.as_ref(), None);
        let summary = Summary::new("sweep", params.search(), &disparities, Some(&confidences), seconds, warnings);
        let summary = Summary { views: placed.len(), fusion: None, ..summary };
        let noise = f64::from(params.noise_q4()) / 16.0;
        let viewed = ViewedMap {
            name: "sweep".into(),
            disparities: &disparities,
            confidences: Some(&confidences),
            metrics: None,
            reduction: None,
            parameters: vec![
                ("method".into(), "sweep".into()),
                ("frames".into(), placed.len().to_string()),
                ("noise".into(), format!("{noise:.1} grey values")),
                ("disparities".into(), format!("{} to {} px", params.search().min_disparity(), params.search().max_disparity())),
                ("time".into(), format!("{:.0} ms", 1e3 * seconds)),
            ],
            costs: None,
            file: None,
        };
        let color = frames.color(Frame::Center).filter(|_| outputs.report.is_some()).cloned();
        let sweep = if outputs.report.is_some() { steps(&params, frames.get(Frame::Center), &images) } else { Vec::new() };
        let frames = (frames, color);
        let matched = Matched { preparation, geometry, center, frame_tree, frame, frames, sweep, truth };
        let summary = self.finish((&source, outputs), matched, viewed, None, summary)?;
        Ok((summary, disparities))
    }
}
