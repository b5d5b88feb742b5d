//! `multiscopic match`: disparities from images.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Args;
use multiscopic::stereo::{LongBaselines, confidence_map::ConfidenceMap, network::Inputs};
use multiscopic::{
    DisparityMap, Error, Geometry, Picture, Result,
    files::{
        output,
        ply::{self, Encoding},
    },
    images::ColorScale,
    report::{Report, ViewedMap, ViewedScene},
};
use multiscopic_core::{Frame, Search};

use super::{
    options::{EngineOptions, GeometryOptions, MapFiles, MatchingOptions, SourceOptions, output_file},
    preparation::{PreparationOptions, mask_unseen},
    terminal::{self, Watch},
    view,
};

/// Matches that take more megabytes say so beforehand.
const MUCH_MEMORY: u64 = 1000;

/// Estimates the disparity of each pixel of a centre image by matching it with its neighbours
#[derive(Clone, Debug, Args)]
pub struct Match {
    #[command(flatten)]
    source: SourceOptions,

    #[command(flatten)]
    matching: MatchingOptions,

    /// Disparities around which all views are searched, instead of over the whole range: a 16-bit image as --raw16 writes,
    /// in pixels of one baseline [default: those of the views at the shortest of several baselines]
    #[arg(long, value_name = "PRIOR.png", conflicts_with = "together", help_heading = "Several baselines")]
    prior: Option<PathBuf>,

    #[command(flatten)]
    preparation: PreparationOptions,

    #[command(flatten)]
    outputs: Outputs,

    #[command(flatten)]
    geometry: GeometryOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// The files that the command writes.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Output")]
struct Outputs {
    #[command(flatten)]
    maps: MapFiles,

    /// Confidences as an 8-bit image: the probability that a disparity is at most one pixel off, times 255, 0 where invalid
    #[arg(long, value_name = "OUT.png", conflicts_with = "prior", value_parser = output_file::png)]
    confidence: Option<PathBuf>,

    /// Depth in metres, +inf where unknown; needs the focal length and the baseline
    #[arg(long, value_name = "OUT.pfm", value_parser = output_file::pfm)]
    depth: Option<PathBuf>,

    /// Depth in colour, with the colours of --png; the nearest and the farthest hundredth are clamped
    #[arg(long, value_name = "OUT.png", value_parser = output_file::png)]
    depth_png: Option<PathBuf>,

    /// What the network of --method net sees of the images, as a folder of arrays for numpy: train/README.md tells what they are
    #[arg(long, value_name = "DIR")]
    features: Option<PathBuf>,

    /// Draw the disparities in the terminal as well
    #[arg(long)]
    preview: bool,

    /// Coloured point cloud in metres, with confidences if --confidence is given; needs the focal length and the baseline
    #[arg(long, value_name = "OUT.ply", value_parser = output_file::ply)]
    ply: Option<PathBuf>,

    /// Page to look at the disparities, the pictures, the costs and the points, see `multiscopic view`
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html)]
    report: Option<PathBuf>,

    /// Write the point cloud as text instead of binary
    #[arg(long, requires = "ply")]
    ply_ascii: bool,
}

impl Match {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let Some(mut source) = self.source.source()? else {
            let message = "there are no images to match: give --center and its neighbours, or RIG_DIR, a folder with a rig.toml";
            return Err(Error::Usage(message.into()));
        };
        let (mut frames, center, undistortion) = source.load()?;
        let mut geometry = self.geometry.geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        if let Some(output) = self.outputs.of_depth() {
            self.geometry.refuse_missing(&output, source.rig.as_ref(), source.lens.as_ref())?;
        }
        self.outputs.check()?;
        let inputs: Vec<&Path> = source.paths().chain(self.prior.as_deref()).collect();
        output::check(&self.outputs.paths(), &inputs)?;
        let engine = self.engine.engine()?;
        let prior = self.prior.as_deref().map(|path| DisparityMap::read_prior(path, frames.size())).transpose()?;
        let (size, views) = (frames.size(), frames.views());
        let search = |range| self.matching.search(size, views, range);
        let preparation = self.preparation.prepare(&source, undistortion.as_ref(), &mut frames, &mut geometry, search)?;
        let search = preparation.search;
        let center = self.outputs.ply.is_some().then(|| match (&preparation.alignment, &undistortion) {
            (Some(alignment), undistortion) => alignment.rectified(Frame::Center, center, undistortion.as_ref()),
            (None, Some(undistortion)) => undistortion.picture(&center),
            (None, None) => center,
        });

        let method = self.matching.method(views)?;
        if let Some(folder) = &self.outputs.features {
            Inputs::new(&frames, &search, &engine, &())?.write(folder)?;
        }
        let color = frames.color(Frame::Center).filter(|_| self.outputs.report.is_some()).cloned();
        if !method.needs_color() {
            frames = frames.without_color();
        }
        let megabytes = method.bytes(&search, &frames).div_ceil(1_000_000);
        if megabytes >= MUCH_MEMORY {
            terminal::say(&format!("matching takes about {megabytes} MB of memory"));
        }
        let watch = Watch::new();
        let start = Instant::now();
        let (mut disparities, mut confidences) = match (prior, method.long_baselines, self.outputs.has_confidences()) {
            (Some(prior), Some(long), _) => {
                let refined = long.refine_prior(&engine, &frames, prior, &watch)?;
                let range = refined.range().map_or(0..=0, |range| range.start().floor() as i16..=range.end().ceil() as i16);
                (method.sharpened(&engine, &frames, frames.views(), range, refined), None)
            }
            (_, _, false) => (method.disparities(&engine, &frames, &search, &watch)?, None),
            (_, _, true) => {
                let (disparities, confidences) = method.disparities_and_confidences(&engine, &frames, &search, &watch)?;
                (disparities, Some(confidences))
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        watch.finish();
        mask_unseen(undistortion.as_ref(), &mut disparities, confidences.as_mut());

        let name = if self.prior.is_some() { "around a prior" } else { self.matching.method.name() };
        let report = self.outputs.report.as_ref().map(|page| -> Result<Report> {
            let truth = source.folder().map(|folder| view::truth(folder, size, &source.images.center)).transpose()?.flatten();
            let truth = truth.map(|truth| preparation.truth(truth));
            let title = source.folder().map_or_else(|| "Disparities".into(), view::title);
            let mut scene = ViewedScene::new(&*title, size)
                .with_geometry(geometry.as_ref())
                .with_frames(&frames, color.as_ref())
                .with_truth(truth.as_ref());
            let results = (&disparities, confidences.as_ref());
            let map = view::matched_map(name.into(), (self.matching.method.name(), &method), &search, results, seconds);
            let file = self.outputs.maps.beside(page);
            scene.add(ViewedMap { file, ..map });
            Ok(Report::new(title).viewer(&view::command_line(), &[scene]))
        });
        let report = report.transpose()?;
        let own = confidences.as_ref().filter(|_| self.outputs.confidence.is_some());
        output::write_together(|| {
            self.outputs.write(&disparities, own, geometry.as_ref(), center.as_ref())?;
            match (&self.outputs.report, &report) {
                (Some(path), Some(report)) => output::write(path, |writer| writer.write_all(report.to_html().as_bytes())),
                _ => Ok(()),
            }
        })?;
        self.outputs.maps.print(&disparities)?;
        if self.outputs.preview {
            let picture = self.outputs.maps.scale(&disparities).draw(&disparities.to_float());
            terminal::print(&terminal::preview(&picture))?;
        }
        terminal::say(&summary(name, &search, &disparities, confidences.as_ref(), seconds));
        preparation.warnings(&disparities, &search).into_iter().for_each(|warning| terminal::say(&format!("warning: {warning}")));
        Ok(ExitCode::SUCCESS)
    }
}

impl Outputs {
    /// Refuses to match for nothing, and two things on standard output.
    fn check(&self) -> Result<()> {
        let is_printed = self.maps.is_printed();
        let complaint = match (self.paths().is_empty() && self.features.is_none(), is_printed, self.preview) {
            (true, false, false) => {
                "there is nothing to write: give -o OUT.pfm, or another output such as --png OUT.png or --preview"
            }
            (_, true, true) => "-o - and --preview both take standard output: give one of them",
            _ => return Ok(()),
        };
        Err(Error::Usage(complaint.into()))
    }

    fn paths(&self) -> Vec<&Path> {
        let Outputs { maps, confidence, depth, depth_png, ply, report, ply_ascii: _, features: _, preview: _ } = self;
        maps.paths().chain([confidence, depth, depth_png, ply, report].into_iter().flatten().map(PathBuf::as_path)).collect()
    }

    fn write(
        &self,
        disparities: &DisparityMap,
        confidences: Option<&ConfidenceMap>,
        geometry: Option<&Geometry>,
        center: Option<&Picture>,
    ) -> Result<()> {
        self.maps.write(disparities)?;
        if let (Some(path), Some(confidences)) = (&self.confidence, confidences) {
            Picture::from(confidences).write_png(path)?;
        }
        if let (Some(path), Some(geometry)) = (&self.depth, geometry) {
            disparities.to_depth(geometry).write_pfm(path)?;
        }
        if let (Some(path), Some(geometry)) = (&self.depth_png, geometry) {
            let depth = disparities.to_depth(geometry);
            self.maps.draw(&depth, &ColorScale::of_depth(self.maps.colormap(), &depth)).write_png(path)?;
        }
        if let (Some(path), Some(geometry), Some(center)) = (&self.ply, geometry, center) {
            let encoding = if self.ply_ascii { Encoding::Ascii } else { Encoding::Binary };
            ply::write(path, disparities, confidences, geometry, center, encoding)?;
        }
        Ok(())
    }

    /// Whether an output has confidences.
    fn has_confidences(&self) -> bool {
        self.confidence.is_some() || self.report.is_some()
    }

    /// The option and the file of an output that needs the geometry, if there is one.
    fn of_depth(&self) -> Option<String> {
        let outputs = [("--depth", &self.depth), ("--depth-png", &self.depth_png), ("--ply", &self.ply)];
        outputs.into_iter().find_map(|(option, path)| Some(format!("{option} {}", path.as_ref()?.display())))
    }
}

/// One line about the match and its result.
fn summary(
    method: &str,
    search: &Search,
    disparities: &DisparityMap,
    confidences: Option<&ConfidenceMap>,
    seconds: f64,
) -> String {
    let valid = disparities.pixels().iter().flatten().count() as f64 / disparities.pixels().len() as f64;
    let sure = confidences.map(terminal::sure).unwrap_or_default();
    let baselines: Vec<String> = LongBaselines::sets(search.views()).iter().map(|views| views.multiple().to_string()).collect();
    let views = match (search.views().len(), &baselines[..]) {
        (1, _) => "1 view".into(),
        (views, [_]) => format!("{views} views"),
        (views, baselines) => format!("{views} views at baselines {}", baselines.join(", ")),
    };
    format!(
        "{}x{}, {method}, {views}, {}, {}..={}: {:.1} % valid{sure}, {:.0} ms",
        search.width(),
        search.height(),
        search.fusion().name(),
        search.min_disparity(),
        search.max_disparity(),
        100.0 * valid,
        1e3 * seconds
    )
}
