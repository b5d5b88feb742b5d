//! `multiscopic demo`: what more views are good for, to look at.

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, value_parser};
use multiscopic::stereo::{CostFunction, Optimizer};
use multiscopic::{
    DisparityMap, Error, Method, Picture, Result, Rig,
    evaluation::{Record, Row, record},
    files::{
        FrameFiles, Provenance,
        image_codec::write_png,
        output,
        ply::{self, Encoding},
    },
    report::{Figure, Report, error_map, montage},
    scene::{PinholeCamera, Scene, Shot, render},
};
use multiscopic_core::{Frame, Fusion, Params, View, Views};

use super::{
    methods::MethodName,
    options::{EngineOptions, SearchOptions},
    terminal,
    variant::{Subject, Variant},
};

/// Makes a scene with known depth, captures five views, matches and evaluates them, and writes pictures and a page about it
#[derive(Debug, Args)]
pub struct Demo {
    /// Folder for the results, made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,

    /// Width of the views in pixels
    #[arg(long, value_name = "N", default_value_t = WIDTH, value_parser = value_parser!(u32).range(16..=4096))]
    width: u32,

    /// Height of the views in pixels
    #[arg(long, value_name = "N", default_value_t = 480, value_parser = value_parser!(u32).range(16..=4096))]
    height: u32,

    /// Decides the sensor's noise and where the stage really stops
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// The width for which the default range of disparities is made.
const WIDTH: u32 = 640;

/// What is compared: stereo first, the default for four views last. The heuristic is the mean where there are two views.
static VARIANTS: [Variant; 6] = [
    variant(Views::STEREO, Fusion::Min),
    variant(Views::HORIZONTAL, Fusion::Min),
    variant(Views::HORIZONTAL, Fusion::Mean),
    variant(Views::ALL, Fusion::Min),
    variant(Views::ALL, Fusion::Mean),
    variant(Views::ALL, Fusion::Heuristic),
];

const fn variant(views: Views, fusion: Fusion) -> Variant {
    Variant { method: MethodName::Bm, views, fusion }
}

/// The frames and what they show.
const FRAMES: [(Frame, &str); 5] = [
    (Frame::Center, "centre, the reference"),
    (Frame::View(View::Left), "left"),
    (Frame::View(View::Right), "right"),
    (Frame::View(View::Top), "top"),
    (Frame::View(View::Bottom), "bottom"),
];
const TRUTH_PFM: &str = "truth.pfm";
const TRUTH_PNG: &str = "truth.png";
const CLOUD: &str = "cloud.ply";
const OVERVIEW: &str = "overview.png";
const PAGE: &str = "index.html";

/// How wide each of the overview's four pictures is at most.
const OVERVIEW_PANEL: u32 = 360;

const ABOUT: &str = "A ray tracer made the views: a still life on a brushed metal table, from 0.4 m to 2.1 m away. It has what \
                     makes matching hard: stems thinner than a block, a blank canvas on the wall, reflections that move with the \
                     camera, patterns that repeat, surfaces that are slanted or curved. The sensor has noise, and the stage misses \
                     its places by up to 0.1 mm. The truth is exact: how far away the ray through the middle of each pixel ends.";

impl Demo {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let params = self.params()?;
        let engine = self.engine.engine()?;
        let folder = Folder::make(&self.output)?;

        let bar = terminal::progress(1 + VARIANTS.len() as u64, "steps");
        bar.set_message("five views");
        let camera = PinholeCamera::new(self.width, self.height);
        let shot = render(&Scene::demo(), &camera, self.seed);
        bar.inc(1);
        let frames = shot.frames(Views::ALL);
        let subject = Subject { dataset: "demo", scene: "demo", frames: &frames, truth: &shot.truth };
        bar.set_message("maps");
        let mut results = Vec::new();
        let cost = CostFunction::Sad { block_size: self.search.block_size() };
        let method = Method::new(cost, None, Optimizer::WinnerTakesAll);
        for (variant, params) in VARIANTS.iter().zip(&params) {
            let (disparities, record) = variant.measure(&method, &engine, &subject, params.search())?;
            results.push(Found { name: name(variant), disparities, record });
            bar.inc(1);
        }
        bar.set_message("files");
        let records: Vec<Record> = results.iter().map(|found| found.record.clone()).collect();
        let rows = record::rows(&records);
        folder.write_capture(&shot, &camera, self.seed)?;
        folder.write_results(&shot, &camera, &results)?;
        let html = self.page(&params[0], &records, &rows).to_html();
        output::write(&folder.path(PAGE), |writer| writer.write_all(html.as_bytes()))?;
        bar.finish_and_clear();

        terminal::print(&record::text(&rows))?;
        terminal::say(&format!("look at {}", folder.path(PAGE).display()));
        Ok(ExitCode::SUCCESS)
    }

    /// The parameters of each variant.
    fn params(&self) -> Result<Vec<Params>> {
        let (min, count) = SearchOptions::RANGE;
        // Disparities grow with the width.
        let count = (u32::from(count) * self.width).div_ceil(WIDTH) as u16;
        let size = [self.width as usize, self.height as usize];
        let params = |variant: &Variant| self.search.params(size, variant.views, Some(variant.fusion), (min, count));
        VARIANTS.iter().map(params).collect()
    }

    fn page(&self, params: &Params, records: &[Record], rows: &[Row]) -> Report {
        let (stereo, best) = (&VARIANTS[0], &VARIANTS[VARIANTS.len() - 1]);
        let map = |variant: &Variant| Figure::linked(caption(variant), map_png(&name(variant)));
        let errors = |variant: &Variant| Figure::linked(caption(variant), errors_png(&name(variant)));
        let truth = || Figure::linked("truth", TRUTH_PNG);
        let Demo { output, width, height, seed, .. } = self;
        let (output, block) = (output.display(), params.block_size());
        let search = format!(
            "--min-disparity {} --num-disparities {} --block-size {block}",
            params.min_disparity(),
            params.num_disparities()
        );
        Report::new("Depth from one camera that moves")
            .paragraph(&summary(records))
            .compare("Stereo and multiscopic", map(stereo), map(best))
            .heading("How far they are from the truth")
            .table(Row::HEADS, rows.iter().map(Row::cells))
            .paragraph(&format!(
                "Disparities from {} to {}, blocks of {block} x {block}. RMS and AvgErr are in pixels, in brackets how far they are \
                 from stereo's; the rest is in percent of the pixels.",
                params.min_disparity(),
                params.max_disparity()
            ))
            .gallery("The five views", FRAMES.map(|(frame, shows)| Figure::linked(shows, FrameFiles::name_of(frame))))
            .paragraph(ABOUT)
            .gallery("Disparities", std::iter::once(truth()).chain(VARIANTS.iter().map(map)))
            .paragraph("Near is red, far is blue, none is black; the colours are the same in all maps.")
            .gallery("Errors", VARIANTS.iter().map(errors))
            .paragraph(&format!("From the truth, {}.", error_map::LEGEND))
            .heading("How to make this again")
            .paragraph("The first line makes this page and all beside it. The second matches the captured folder, as it would a real one.")
            .code(&format!(
                "multiscopic demo --width {width} --height {height} --seed {seed} {search} -o {output}\n\
                 multiscopic match {output} {search} -o disparities.pfm --png disparities.png"
            ))
    }
}

/// What a variant found, and what it is worth.
struct Found {
    name: String,
    disparities: DisparityMap,
    record: Record,
}

/// Where the results are written.
struct Folder(PathBuf);

impl Folder {
    /// Makes the folder, if it is not there, and checks that the results can be written.
    fn make(path: &Path) -> Result<Folder> {
        fs::create_dir_all(path).map_err(|source| Error::Write { path: path.into(), source })?;
        let folder = Folder(path.into());
        let maps = VARIANTS.iter().map(name).flat_map(|name| [map_pfm(&name), map_png(&name), errors_png(&name)]);
        let others = [Rig::FILE_NAME, TRUTH_PFM, TRUTH_PNG, CLOUD, OVERVIEW, PAGE];
        let names = FRAMES.map(|(frame, _)| FrameFiles::name_of(frame)).into_iter().chain(others.map(String::from)).chain(maps);
        let paths: Vec<PathBuf> = names.map(|name| folder.path(&name)).collect();
        output::check(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[])?;
        Ok(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes what a camera and its stage would leave, and the truth.
    fn write_capture(&self, shot: &Shot, camera: &PinholeCamera, seed: u64) -> Result<()> {
        for (frame, _) in FRAMES {
            write_png(&self.path(&FrameFiles::name_of(frame)), shot.frame(frame))?;
        }
        rig(camera, seed).save(&self.0)?;
        shot.truth.write_pfm(&self.path(TRUTH_PFM))
    }

    /// Writes all maps and the pictures of them.
    fn write_results(&self, shot: &Shot, camera: &PinholeCamera, results: &[Found]) -> Result<()> {
        let truth = DisparityMap::from_float(&shot.truth);
        let range = truth.range();
        let color = |map: &DisparityMap| map.to_color(range.clone());
        write_png(&self.path(TRUTH_PNG), &color(&truth))?;
        for Found { name, disparities, .. } in results {
            let errors = error_map::draw(disparities.pixels().iter().map(|d| d.map(f32::from)), &shot.truth);
            disparities.write_pfm(&self.path(&map_pfm(name)))?;
            write_png(&self.path(&map_png(name)), &color(disparities))?;
            write_png(&self.path(&errors_png(name)), &errors)?;
        }
        let [Found { disparities: stereo, .. }, .., Found { disparities: best, .. }] = results else {
            unreachable!("there are several variants")
        };
        let center = Picture::Rgb(shot.center.clone());
        let geometry = rig(camera, 0).geometry().expect("the focal length is the camera's");
        ply::write(&self.path(CLOUD), best, &geometry, &center, Encoding::Binary)?;
        let panels = [&shot.center, &color(stereo), &color(best), &color(&truth)];
        write_png(&self.path(OVERVIEW), &montage::row(panels, OVERVIEW_PANEL))
    }
}

/// The short name of a variant, for files.
fn name(variant: &Variant) -> String {
    match variant.views.len() {
        1 => "stereo".into(),
        views => format!("{views}-views-{}", variant.fusion.name()),
    }
}

fn caption(variant: &Variant) -> String {
    match variant.views.len() {
        1 => "stereo: centre and right".into(),
        views => format!("multiscopic: {views} views, {}", variant.fusion.name()),
    }
}

fn map_pfm(name: &str) -> String {
    format!("{name}.pfm")
}

fn map_png(name: &str) -> String {
    format!("{name}.png")
}

fn errors_png(name: &str) -> String {
    format!("{name}-errors.png")
}

/// What is known about camera and stage.
fn rig(camera: &PinholeCamera, seed: u64) -> Rig {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    Rig {
        baseline_mm: camera.baseline_mm,
        focal_px: Some(camera.focal_px),
        principal_point: [middle(camera.width), middle(camera.height)],
        doffs: 0.0,
        images: FrameFiles::of_capture(Views::ALL),
        capture: Provenance {
            camera: Some("ray tracer".into()),
            stage: Some("simulated".into()),
            repeatability_mm: Some(camera.repeatability_mm),
            notes: Some(format!("the scene of multiscopic demo, seed {seed}")),
            ..Provenance::default()
        },
    }
}

/// The first and the last record in words.
fn summary(records: &[Record]) -> String {
    let [stereo, .., best] = records else { unreachable!("there are several variants") };
    let numbers = |record: &Record| {
        let (rms, bad) = (record.metrics.rms, record.metrics.bad_1);
        format!("an RMS error of {rms:.2} px, and {bad:.1} % of the pixels are off by more than one")
    };
    format!(
        "A camera takes a picture, is moved by a baseline to the left, to the right, up and down, and takes one each time. Matched \
         with one neighbour, as in stereo, the centre gives disparities with {}. Matched with all {} at once, it gives {}.",
        numbers(stereo),
        best.views,
        numbers(best)
    )
}
