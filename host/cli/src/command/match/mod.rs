//! `multiscopic match`: disparities from images.

mod limits;
mod outputs;
mod sweep;

use std::{
    fmt::{self, Display},
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Args;
use image::RgbImage;
use multiscopic::{
    DisparityMap, Engine, Error, FloatImage, Frames, Geometry, Inspection, MatchSetup, Picture, RangeSource, Result,
    files::{Cloud, ListedRig, MatchedImages, output},
    images::{FrameTree, PointFrame},
    stereo::{
        BaselineRefinement,
        confidence_map::{self, ConfidenceMap},
        network::Inputs,
        write_inputs,
    },
};
use multiscopic_core::{Disparity, Frame, SearchSpace};
use serde::{Deserialize, Serialize};

use self::{
    limits::Limits,
    outputs::{Findings, Outputs},
};
use super::{
    advice,
    batch::{BatchOptions, Done, RunSettings},
    options::{EngineOptions, GeometryOptions, MatchingOptions, PRIOR_EXCLUDES, PreparationOptions, Source, SourceOptions},
    preparation::{mask_unseen, prepare, read_disparities, say_if_much},
    scene::truth_file,
    terminal::{self, Watch},
    view,
};
use crate::report::{Report, SweepStep, ViewedMap, ViewedScene};

/// The largest disparity that can be searched, in pixels.
const MOST_DISPARITY: usize = Disparity::MAX_SEARCH as usize;

/// Estimates the disparity of each pixel of a centre image by matching it with its neighbours
#[derive(Clone, Debug, Args)]
pub struct Match {
    #[command(flatten)]
    source: SourceOptions,

    /// Match every captured folder in a list, which has the path of one on each line; relative ones are relative to the list. The
    /// outputs of a rig go to a folder in --results, named as the rig's path in the list: give their names alone, such as
    /// -o disparity.pfm. A rig that fails does not stop the others
    #[arg(
        long,
        value_name = "RIGS.txt",
        requires = "results",
        conflicts_with_all = ["rig", "center", "left", "right", "top", "bottom", "view", "prior", "features", "preview", "json"],
        help_heading = "Many items, on many machines"
    )]
    list: Option<PathBuf>,

    #[command(flatten)]
    batch: BatchOptions,

    #[command(flatten)]
    matching: MatchingOptions,

    /// Disparities around which all views are searched, instead of over the whole range, of one baseline: in pixels, not finite
    /// where unknown, as PFM, NPY, NPZ or TIFF; or in a 16-bit image as --raw16, KITTI or OpenCV store them [default: those of
    /// the views at the shortest of several baselines]
    #[arg(long, value_name = "PRIOR", conflicts_with_all = PRIOR_EXCLUDES, help_heading = "Several baselines")]
    prior: Option<PathBuf>,

    #[command(flatten)]
    preparation: PreparationOptions,

    /// Match images that are N times smaller; disparities are in their pixels [default: 1, or what makes the disparities that the
    /// images show at most 511]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16), help_heading = "Matching")]
    shrink: Option<u32>,

    #[command(flatten)]
    limits: Limits,

    #[command(flatten)]
    outputs: Outputs,

    #[command(flatten)]
    geometry: GeometryOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

impl Match {
    /// Runs the command, with these settings for the rigs of a list.
    pub fn run(&self, settings: &RunSettings) -> Result<ExitCode> {
        if let Some(list) = &self.list {
            return self.run_list(list, settings);
        }
        if self.batch.is_given() {
            let message = "--results is for the rigs of a list: give --list RIGS.txt, or -o OUT.pfm for the results of one rig";
            return Err(Error::Usage(message.into()));
        }
        let Some(source) = self.source.source()? else {
            let message = "there are no images to match: give --center and its neighbours, or RIG_DIR, a folder with a rig.toml";
            return Err(Error::Usage(message.into()));
        };
        let (summary, disparities) = self.matched(source, &self.outputs, &self.engine.engine()?, settings)?;
        self.outputs.maps.print(&disparities)?;
        if self.outputs.preview {
            let picture = self.outputs.maps.scale(&disparities).draw(&disparities.to_float());
            terminal::print_bytes(terminal::preview(&picture).as_bytes())?;
        }
        summary.warnings().iter().for_each(|warning| terminal::warn(warning));
        match self.outputs.json {
            true => terminal::print_report(&summary, true)?,
            false => terminal::say(&summary.to_string()),
        }
        Ok(ExitCode::SUCCESS)
    }

    /// The file of the true disparities, if a report shows them.
    fn truth_file(&self, source: &Source) -> Option<PathBuf> {
        self.outputs.report.as_ref().and(source.folder()).and_then(truth_file)
    }

    /// The factor by which the frames are shrunk: as asked for, or so that the disparities that they show can be searched.
    fn shrink_factor(&self, frames: &Frames) -> Result<u32> {
        let is_found = self.matching.search.range_source(&self.preparation) != RangeSource::Paper;
        match self.shrink {
            Some(factor) => Ok(factor),
            // Those of smaller images are small.
            None if !is_found || frames.width().max(frames.height()) <= 2 * MOST_DISPARITY => Ok(1),
            None => {
                let shown = Inspection::of(frames).shown_range();
                let farthest = shown.map_or(0, |shown| shown.start().unsigned_abs().max(shown.end().unsigned_abs()));
                Ok(usize::from(farthest).div_ceil(MOST_DISPARITY).max(1) as u32)
            }
        }
    }

    /// Matches the images of a rig, and writes the outputs together.
    fn matched(
        &self,
        mut source: Source,
        outputs: &Outputs,
        engine: &Engine,
        settings: &RunSettings,
    ) -> Result<(Summary, DisparityMap)> {
        if let Some(sweep) = source.load_sweep()? {
            return self.matched_sweep(source, sweep, outputs, engine, settings);
        }
        let (mut frames, mut center, mut undistortion) = source.load()?;
        let mut geometry = self.geometry.geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        let truth = self.check_outputs(&source, outputs)?;
        let shrink = self.shrink_factor(&frames)?;
        if shrink > 1 {
            source = source.shrunk(shrink);
            (frames, center, undistortion) = source.load()?;
            geometry = geometry.map(|geometry| geometry.shrunk(shrink));
        }
        let (size, views) = (frames.size(), frames.views());
        self.limits.check(size)?;
        let search = |range| self.matching.search(size, views, range);
        let ways = (&self.preparation, self.matching.search.range_source(&self.preparation));
        let preparation = prepare(ways, &source, undistortion.as_ref(), &mut frames, &mut geometry, &self.engine.memory, search)?;
        let hand_eye = outputs.hand_eye.as_deref();
        let frame_tree = source.frame_tree(undistortion.as_ref(), preparation.alignment.as_ref(), hand_eye)?;
        let frame = outputs.frame(&frame_tree)?;
        let search = preparation.search;
        let images = source.images.center.clone();
        let images = MatchedImages { center: &images, size, seen: preparation.inspection.corner_disparities() };
        let prior = self.prior.as_deref().map(|path| read_disparities(path, Some(&images))).transpose()?;
        let prior = prior.map(|prior| DisparityMap::from_float(&prior));
        let center = outputs.has_center().then(|| match (&preparation.alignment, &undistortion) {
            (Some(alignment), undistortion) => alignment.rectified(Frame::Center, center, undistortion.as_ref()),
            (None, Some(undistortion)) => undistortion.picture(Frame::Center, &center),
            (None, None) => center,
        });

        let method = match &prior {
            Some(_) => self.matching.method_around_prior(views)?,
            None => self.matching.method(views)?,
        };
        if let Some(folder) = &outputs.features {
            write_inputs(&Inputs::new(&frames.planes(), &search, engine, &())?, folder)?;
        }
        let color = frames.color(Frame::Center).filter(|_| outputs.report.is_some()).cloned();
        say_if_much("matching", method.bytes(&search, &frames));
        let (method, frames) = preparation.suited(method, frames);
        let watch = Watch::new();
        let start = Instant::now();
        let has_deviations = geometry.is_some() && method.has_deviations();
        if let Some(option) = outputs.sigma.as_ref().map(|_| "--sigma").or(self.limits.max_sigma.map(|_| "--max-sigma"))
            && !has_deviations
        {
            let name = self.matching.method.name();
            return Err(Error::Usage(format!(
                "{option}: the errors of {name} were not measured, so that its deviations are unknown: give --method net, bm, sgm \
                 or gc"
            )));
        }
        // They take memory and time, so that whoever asks for disparities alone does without.
        let wants_deviations = has_deviations && (outputs.of_depth().is_some() || self.limits.max_sigma.is_some());
        let (mut disparities, mut confidences, baselines) = match (prior, outputs.has_confidences() || wants_deviations) {
            (Some(prior), _) => (method.disparities_around(engine, &frames, prior, &watch)?, None, None),
            (None, false) => (method.disparities(engine, &frames, &search, &watch)?, None, None),
            (None, true) => {
                let found = method.estimate(engine, &frames, &search, &watch)?;
                (found.disparities, Some(found.confidences), Some(found.baselines))
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        watch.finish();
        mask_unseen(undistortion.as_ref(), &mut disparities, confidences.as_mut());
        let deviations = confidences.as_ref().zip(baselines).zip(geometry.as_ref()).filter(|_| wants_deviations);
        let deviations = deviations.and_then(|((confidences, baselines), geometry)| {
            let deviations = method.deviations(engine, &frames, search.views(), &disparities, confidences, &baselines)?;
            let of_baseline = source.rig.as_ref().map_or(0.0, |rig| rig.baseline_deviation_mm(search.views()));
            Some(geometry.depth_deviations(&disparities, &deviations, of_baseline))
        });
        self.limits.apply(&mut disparities, confidences.as_mut(), geometry.as_ref(), deviations.as_ref());
        let mut warnings = Vec::new();
        if self.shrink.is_none() && shrink > 1 {
            warnings.push(format!(
                "the images were shrunk by {shrink}, since their disparities are above {MOST_DISPARITY}; disparities are in pixels of \
                 the smaller images (--shrink)"
            ));
        }
        let name = if self.prior.is_some() { "around a prior" } else { self.matching.method.name() };
        let results = (&disparities, confidences.as_ref());
        let viewed = view::matched_map(name.into(), (self.matching.method.name(), &method), &search, results, Some(seconds));
        let summary = Summary::new(name, &search, &disparities, confidences.as_ref(), seconds, warnings);
        let (frames, sweep) = ((frames, color), Vec::new());
        let matched = Matched { preparation, geometry, center, frame_tree, frame, frames, sweep, truth };
        let summary = self.finish((&source, outputs), matched, viewed, deviations.as_ref(), summary)?;
        Ok((summary, disparities))
    }

    /// Refuses outputs that cannot be written, and returns the file of the truth that is read for them.
    fn check_outputs(&self, source: &Source, outputs: &Outputs) -> Result<Option<PathBuf>> {
        if let Some(output) = outputs.of_depth().or(self.limits.of_depth().map(String::from)) {
            self.geometry.refuse_missing(&output, source.rig.as_ref(), source.lens.as_ref())?;
        }
        outputs.check()?;
        let truth = self.truth_file(source);
        let inputs: Vec<&Path> = source.paths().chain(self.prior.as_deref()).chain(truth.as_deref()).collect();
        output::check(&outputs.paths(), &inputs)?;
        Ok(truth)
    }

    /// Writes the outputs together, and completes the summary, which has the warnings of the method.
    fn finish(
        &self,
        (source, outputs): (&Source, &Outputs),
        matched: Matched,
        map: ViewedMap<'_>,
        deviations: Option<&FloatImage>,
        mut summary: Summary,
    ) -> Result<Summary> {
        let (disparities, confidences) = (map.disparities, map.confidences);
        let Matched { preparation, geometry, center, frame_tree, frame, frames: (frames, color), sweep, truth } = matched;
        let (size, search) = (frames.size(), preparation.search);
        let of_images = advice::warnings(&preparation, disparities, &search);
        let of_images = if summary.fusion.is_none() {
            of_images.iter().map(|warning| advice::of_sweep(warning)).collect()
        } else {
            of_images
        };
        summary.warnings.splice(0..0, of_images);
        let of_depth = geometry.as_ref().filter(|_| outputs.of_depth().is_some());
        if let Some(geometry) = of_depth {
            let odd: Vec<String> = geometry.warnings(disparities).iter().map(advice::warning).collect();
            summary.warnings.splice(0..0, advice::no_depth(disparities, geometry).map(String::from).into_iter().chain(odd));
        }
        let report = outputs.report.as_ref().map(|page| -> Result<Report> {
            let seen = preparation.inspection.corner_disparities();
            let images = MatchedImages { center: &source.images.center, size, seen };
            let truth = truth.map(|path| read_disparities(&path, Some(&images))).transpose()?;
            let truth = truth.map(|truth| preparation.truth(truth));
            let title = source.folder().map_or_else(|| "Disparities".into(), view::title);
            let mut scene = ViewedScene::new(&*title, size)
                .with_geometry(geometry.as_ref())
                .with_frames(&frames, color.as_ref())
                .with_truth(truth.as_ref())
                .with_sweep(&sweep);
            let file = outputs.maps.beside(page);
            scene.add(ViewedMap { file, ..map });
            let page =
                summary.warnings.iter().fold(Report::new(title), |page, warning| page.paragraph(&format!("Warning: {warning}.")));
            Ok(page.viewer(&view::command_line(), &[scene]))
        });
        let report = report.transpose()?;
        output::write_together(|| {
            let findings = Findings {
                disparities,
                confidences,
                deviations,
                geometry: geometry.as_ref(),
                cloud: geometry.as_ref().zip(center.as_ref()).map(|(geometry, center)| Cloud {
                    confidences,
                    deviations,
                    edges: self.limits.edges(),
                    frame,
                    frames: frame_tree,
                    ..Cloud::new(disparities, center, geometry)
                }),
            };
            outputs.write(&findings)?;
            #[cfg(feature = "mcap")]
            outputs.record(&search, &findings, source.exposed())?;
            match (&outputs.report, &report) {
                (Some(path), Some(report)) => output::write(path, |writer| writer.write_all(report.to_html().as_bytes())),
                _ => Ok(()),
            }
        })?;
        Ok(Summary {
            frame: (outputs.has_center() && geometry.is_some()).then(|| frame.name().into()),
            median_depth_mm: of_depth.and_then(|geometry| geometry.median_depth_mm(disparities)),
            within: deviations
                .zip(geometry.as_ref())
                .and_then(|(deviations, geometry)| Within::new(disparities, deviations, geometry.median_depth_mm(disparities)?)),
            ..summary
        })
    }

    /// Matches the rigs of a list that belong to the share of this machine.
    fn run_list(&self, list: &Path, settings: &RunSettings) -> Result<ExitCode> {
        if self.outputs.within(Path::new(""))?.paths().is_empty() {
            let message = "there is nothing to write: give -o disparity.pfm, or another output such as --png disparity.png";
            return Err(Error::Usage(message.into()));
        }
        let rigs = ListedRig::read_all(list)?;
        let engine = self.engine.engine()?;
        let Some(batch) = self.batch.batch(settings, rigs.iter().map(|rig| rig.name.clone()))? else {
            return Err(Error::Usage("--list needs a folder for the results: give --results DIR".into()));
        };
        let inputs = |index: usize| {
            let source = self.source.source_of(&rigs[index].directory)?;
            Ok(source.paths().map(PathBuf::from).chain(self.truth_file(&source)).collect())
        };
        let work = |index: usize, folder: &Path| {
            let ListedRig { name, directory } = &rigs[index];
            let outputs = self.outputs.within(folder)?;
            let (summary, _) = self.matched(self.source.source_of(directory)?, &outputs, &engine, settings)?;
            summary.warnings().iter().for_each(|warning| terminal::warn(&format!("{name}: {warning}")));
            terminal::say(&format!("{name}: {summary}"));
            Ok(Done { results: summary.without_time(), outputs: outputs.paths().into_iter().map(PathBuf::from).collect() })
        };
        Ok(batch.run(inputs, work))
    }
}

/// The images of a match, and what is known of them.
struct Matched {
    preparation: MatchSetup,
    geometry: Option<Geometry>,
    /// The centre as it was matched, in all its colours, if an output has it.
    center: Option<Picture>,
    frame_tree: FrameTree,
    /// The frame of the points.
    frame: PointFrame,
    /// The frames that a page shows, and the colours of the centre.
    frames: (Frames, Option<RgbImage>),
    /// The steps of a sweep that a page shows.
    sweep: Vec<SweepStep>,
    /// The file of the true disparities, if a page shows them.
    truth: Option<PathBuf>,
}

/// The outcome of a match. Shares are from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    width: usize,
    height: usize,
    method: String,
    views: usize,
    /// Their baselines, in multiples of the shortest.
    baselines: Vec<u32>,
    /// The rule by which the costs of the views were fused; none in a sweep, whose frames refine what those before found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fusion: Option<String>,
    min_disparity: i16,
    num_disparities: usize,
    /// The share of pixels with a disparity.
    valid: f64,
    /// The share with a confidence from 0.9 on, if confidences were computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    sure: Option<f64>,
    /// The frame of the points, if points were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    frame: Option<String>,
    /// The precision of the depths, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    within: Option<Within>,
    /// The median depth, if depths were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    median_depth_mm: Option<f64>,
    /// The seconds that the match took, unless it is one of many.
    #[serde(skip_serializing_if = "Option::is_none")]
    milliseconds: Option<f64>,
    warnings: Vec<String>,
}

/// The share of all pixels whose points are more precise than a length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Within {
    /// The length in millimetres: a hundredth of the median depth, rounded down to 1, 2 or 5 times a power of ten.
    mm: f64,
    /// The share of pixels whose depth has a standard deviation of at most half of that, so that 95 % of them are within it.
    share: f64,
    /// The median standard deviation of the depths in millimetres.
    median_sigma_mm: f64,
}

impl Within {
    /// Of a map of this median depth, whose depths have these standard deviations in metres. `None` without any depth.
    fn new(disparities: &DisparityMap, deviations: &FloatImage, median_depth_mm: f64) -> Option<Within> {
        let known = disparities.pixels().iter().zip(deviations.pixels()).filter(|(d, sigma)| d.is_some() && sigma.is_finite());
        let mut sigmas: Vec<f64> = known.map(|(_, metres)| 1000.0 * f64::from(*metres)).collect();
        sigmas.sort_by(f64::total_cmp);
        let median_sigma_mm = *sigmas.get(sigmas.len() / 2)?;
        let hundredth = median_depth_mm / 100.0;
        let unit = 10f64.powf(hundredth.log10().floor());
        let mm = [5.0, 2.0].into_iter().map(|factor| factor * unit).find(|mm| *mm <= hundredth).unwrap_or(unit);
        let share = sigmas.partition_point(|sigma| 2.0 * sigma <= mm) as f64 / deviations.pixels().len() as f64;
        Some(Within { mm, share, median_sigma_mm })
    }
}

impl Display for Within {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{:.0} % within {} mm (95 % sure)", 100.0 * self.share, self.mm)
    }
}

impl Summary {
    /// Of a map that took so many seconds.
    fn new(
        method: &str,
        search: &SearchSpace,
        disparities: &DisparityMap,
        confidences: Option<&ConfidenceMap>,
        seconds: f64,
        warnings: Vec<String>,
    ) -> Summary {
        Summary {
            width: search.width(),
            height: search.height(),
            method: method.into(),
            views: search.views().len(),
            baselines: BaselineRefinement::sets(search.views()).iter().map(|views| u32::from(views.multiple())).collect(),
            fusion: Some(search.fusion().name().into()),
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            valid: disparities.pixels().iter().flatten().count() as f64 / disparities.pixels().len() as f64,
            sure: confidences.map(confidence_map::sure_share),
            frame: None,
            within: None,
            median_depth_mm: None,
            milliseconds: Some(1e3 * seconds),
            warnings,
        }
    }

    /// The headings of [`cells`](Summary::cells).
    pub const HEADINGS: [&str; 6] = ["method", "rig", "size", "views", "disparities", "valid %"];

    /// The row of a rig in a table.
    pub fn cells(&self, rig: &str) -> [String; 6] {
        let size = format!("{}x{}", self.width, self.height);
        let valid = format!("{:.2}", 100.0 * self.valid);
        [self.method.clone(), rig.into(), size, self.views.to_string(), self.range(), valid]
    }

    /// The smallest and the largest disparity.
    fn range(&self) -> String {
        let last = i32::from(self.min_disparity) + self.num_disparities as i32 - 1;
        format!("{}..={last}", self.min_disparity)
    }

    /// The same without the time, which is another on each machine.
    fn without_time(self) -> Summary {
        Summary { milliseconds: None, ..self }
    }

    /// Returns what the user should know.
    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Summary { width, height, method, .. } = self;
        let fusion = self.fusion.as_ref().map(|fusion| format!(", {fusion}")).unwrap_or_default();
        let views = match (self.views, &self.baselines[..]) {
            (1, _) => "1 view".into(),
            (views, [_]) => format!("{views} views"),
            (views, baselines) => {
                let baselines: Vec<String> = baselines.iter().map(u32::to_string).collect();
                format!("{views} views at baselines {}", baselines.join(", "))
            }
        };
        write!(f, "{width}x{height}, {method}, {views}{fusion}, {}: {:.1} % valid", self.range(), 100.0 * self.valid)?;
        let sure = self.sure.map(terminal::sure).unwrap_or_default();
        match &self.within {
            Some(within) => write!(f, ", {within}")?,
            None => write!(f, "{sure}")?,
        }
        if let Some(depth_mm) = self.median_depth_mm {
            write!(f, ", median depth {depth_mm:.0} mm")?;
        }
        self.milliseconds.map_or(Ok(()), |milliseconds| write!(f, ", {milliseconds:.0} ms"))
    }
}
