//! `multiscopic evaluate`: the accuracy of methods on data sets with ground truth, and of rigs.

mod comparison;
mod data_set;
mod rigs;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Dataset, Error, FloatImage, Frames, Geometry, MatchSetup, RangeSource, Result, Rig,
    files::{MatchedImages, output},
    images::ImageRegion,
    lens::Undistortion,
};
use serde::Serialize;

use self::comparison::Comparison;
pub use self::data_set::SceneRecord;
use super::{
    batch::{BatchOptions, RunSettings},
    options::{
        BaselineOptions, BitsOption, EngineOptions, GeometryOptions, MemoryOptions, MethodOptions, PreparationOptions,
        SearchOptions, Source, named, output_file, value::positive,
    },
    preparation::{prepare, read_disparities},
    scene::truth_file,
    terminal,
};
use crate::{
    report::Report,
    results::{self, Record},
};

/// The most bytes that the scenes of a page take, unless their disparities alone take more.
const PAGE_BYTES: usize = 16_000_000;

/// Measures how good matching is on a data set with ground truth, or how good a rig is
///
/// A captured folder is compared with the truth, if it is known, and with a plane, if the scene is a flat wall (--plane). Several
/// captures of the same scene by the same rig show its noise.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Captured folder with a rig.toml, or several of the same scene; with --dataset, the folder of the data set, of one of its
    /// scenes, or the parent of the data set's folder
    #[arg(value_name = "DIR", required = true)]
    directories: Vec<PathBuf>,

    /// Data set
    #[arg(
        long,
        value_name = "NAME",
        value_parser = named::<Dataset>(),
        conflicts_with_all = ["PreparationOptions", "GeometryOptions"]
    )]
    dataset: Option<Dataset>,

    /// Scenes of the data set [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    scenes: Vec<String>,

    #[command(flatten)]
    comparison: Comparison,

    /// Write the results as a JSON list
    #[arg(long, value_name = "FILE", conflicts_with = "results")]
    json: Option<PathBuf>,

    /// Write a page with the tables and pictures, and for data sets with charts of the error over the number of views and over
    /// the baseline
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html(), conflicts_with = "results")]
    report: Option<PathBuf>,

    #[command(flatten)]
    batch: BatchOptions,

    #[command(flatten)]
    rig: RigOptions,

    #[command(flatten)]
    geometry: GeometryOptions,

    #[command(flatten)]
    preparation: PreparationOptions,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    long_baselines: BaselineOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

impl Evaluate {
    /// Runs the command, with these settings for the scenes of a data set.
    pub fn run(&self, settings: &RunSettings) -> Result<ExitCode> {
        match (self.dataset, &self.directories[..]) {
            (None, _) => {
                let scenes = (!self.scenes.is_empty()).then_some("--scenes");
                // Captures of one scene are compared with each other, which one machine does.
                let results = self.batch.is_given().then_some("--results");
                if let Some(option) = scenes.or(results).or(self.comparison.dataset_option()) {
                    return Err(Error::Usage(format!("{option} is for data sets: give --dataset as well")));
                }
                self.run_rigs()?;
                Ok(ExitCode::SUCCESS)
            }
            (Some(dataset), [directory]) => self.run_dataset(dataset, directory, settings),
            (Some(dataset), directories) => {
                let count = directories.len();
                Err(Error::Usage(format!("--dataset {dataset} takes one folder, not {count}: choose scenes by --scenes")))
            }
        }
    }

    /// The files that are written.
    fn outputs(&self) -> Vec<&Path> {
        self.json.iter().chain(&self.report).map(PathBuf::as_path).collect()
    }

    /// Writes the results as JSON and the report, if they are asked for.
    fn write(&self, records: &[impl Serialize], report: Option<Report>) -> Result<()> {
        output::write_together(|| {
            if let Some(path) = &self.json {
                write_json(records, path)?;
            }
            if let (Some(path), Some(report)) = (&self.report, report) {
                output::write(path, |writer| writer.write_all(report.to_html().as_bytes()))?;
            }
            Ok(())
        })
    }
}

/// Writes results as a JSON list.
pub fn write_json(records: &[impl Serialize], path: &Path) -> Result<()> {
    let json = serde_json::to_string_pretty(records).expect("numbers and strings");
    output::write(path, |writer| writeln!(writer, "{json}"))
}

/// Prints the tables of results on a data set.
pub fn print_tables(records: &[Record]) -> Result<()> {
    let limit = terminal::columns();
    let errors = results::to_text(&results::rows(records), limit);
    let measured: [(&[&str], _); 2] = [
        (&results::CONFIDENCE_HEADINGS, results::confidence_rows(records)),
        (&results::LIGHT_FIELD_HEADINGS, results::light_field_rows(records)),
    ];
    let tables = measured.iter().filter(|(_, rows)| !rows.is_empty());
    let tables = tables.map(|(headings, rows)| format!("\n{}", results::text_table(headings, rows, 2, limit)));
    terminal::print(&[errors].into_iter().chain(tables).collect::<String>())
}

/// The references that captured folders are compared with.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Captured folders")]
struct RigOptions {
    /// True disparities of the centre at the nearest baseline: in pixels, not finite where unknown, as PFM, NPY, NPZ or TIFF;
    /// or in a 16-bit image as --raw16, KITTI or OpenCV store them [default: truth.pfm in RIG_DIR, if it is there]
    #[arg(long, value_name = "TRUTH", conflicts_with = "dataset")]
    truth: Option<PathBuf>,

    /// The scene is a flat wall, at this distance along the optical axis if it is given: measure how flat it seems, and how far
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true, conflicts_with = "dataset")]
    plane: Option<Option<f64>>,

    /// Part of the centre that shows the wall, in pixels: left and top edge, width and height [default: the middle half of both
    /// sides]
    #[arg(long, value_name = "X,Y,W,H", requires = "plane")]
    region: Option<ImageRegion>,

    /// Calibration of the lens, which distorts all images: a camera.toml, or a file of ROS, OpenCV or Kalibr [default: the lens
    /// of rig.toml]
    #[arg(long, value_name = "FILE", conflicts_with = "dataset")]
    lens: Option<PathBuf>,

    #[command(flatten)]
    bits: BitsOption,
}

/// The files of a captured folder.
struct RigFiles {
    /// The folder.
    directory: PathBuf,
    /// Its rig and images.
    source: Source,
    /// The file of its true disparities, if they are known.
    truth: Option<PathBuf>,
}

/// A capture, ready to be matched.
struct PreparedRig {
    /// The frames, undistorted and rectified.
    frames: Frames,
    /// The table that undistorted them, if the lens is known.
    undistortion: Option<Undistortion>,
    /// The geometry, if it is known.
    geometry: Option<Geometry>,
    /// The true disparities of the centre, if they are known.
    truth: Option<FloatImage>,
    /// Their preparation, with what it found.
    preparation: MatchSetup,
}

impl RigOptions {
    /// The files of a captured folder.
    fn files(&self, directory: &Path) -> Result<RigFiles> {
        if Rig::file_in(directory).is_none() {
            let directory = directory.display();
            return Err(Error::Usage(format!(
                "{directory} has no {}: give a captured folder, or --dataset with the folder of a data set",
                Rig::FILE_NAME
            )));
        }
        Ok(RigFiles {
            directory: directory.into(),
            source: Source::of_rig(directory, self.lens.as_deref(), &self.bits)?,
            truth: self.truth.clone().or_else(|| truth_file(directory)),
        })
    }

    /// The part of an image that shows the wall, or all of it if there is none.
    fn region(&self, size: [usize; 2]) -> ImageRegion {
        match self.plane {
            Some(_) => self.region.unwrap_or(ImageRegion::middle(size)),
            None => ImageRegion::whole(size),
        }
    }
}

impl RigFiles {
    /// All files that are read.
    fn paths(&self) -> impl Iterator<Item = &Path> {
        self.source.paths().chain(self.truth.as_deref())
    }

    /// Reads and prepares the capture.
    fn load(
        &mut self,
        geometry: &GeometryOptions,
        preparation: &PreparationOptions,
        search: &SearchOptions,
        memory: &MemoryOptions,
    ) -> Result<PreparedRig> {
        let (mut frames, _, undistortion) = self.source.load()?;
        let Source { rig, lens, images, .. } = &self.source;
        let mut geometry = geometry.geometry(rig.as_ref(), lens.as_ref(), &frames)?;
        let (size, views) = (frames.size(), frames.views());
        let search = |range| search.search(size, views, None, range);
        let range_source = if preparation.auto_range { RangeSource::ImagesAlone } else { RangeSource::Paper };
        let ways = (preparation, range_source);
        let preparation = prepare(ways, &self.source, undistortion.as_ref(), &mut frames, &mut geometry, memory, search)?;
        let images = MatchedImages { center: &images.center, size, seen: preparation.inspection.corner_disparities() };
        let truth = self.truth.as_ref().map(|path| read_disparities(path, Some(&images))).transpose()?;
        let truth = truth.map(|truth| preparation.truth(truth));
        Ok(PreparedRig { frames, undistortion, geometry, truth, preparation })
    }
}
