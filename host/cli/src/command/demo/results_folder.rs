//! The folder of results: a capture as a rig would leave it, the truth, the maps, and the page.

use std::{
    fs,
    path::{Path, PathBuf},
};

use multiscopic::{
    DisparityMap, Error, Method, Picture, Result, Rig,
    files::{
        Cloud, FrameFiles,
        image_codec::write_png,
        input, output,
        ply::{self, Encoding},
    },
    images::montage,
    scene::{PinholeCamera, Shot},
    stereo::{MethodName, confidence_map::ConfidenceMap},
};
use multiscopic_core::{BlockMatchingParams, Frame, SearchSpace, View, Views};

use super::variants::{self, caption, stem};
use crate::{
    command::{
        scene::{self, TRUTH_FILE_NAME},
        variant::{Errors, Variant},
    },
    report::{Figure, PictureColumn, Report, ViewedScene, contact_sheet, error_map},
    results::{Record, ResultRow},
};

/// The frames, with their captions.
fn frames(views: Views) -> Vec<(Frame, String)> {
    let caption = |view: View| match view.name() {
        Some(name) => name.to_owned(),
        None => format!("{view}: baselines to the right and down"),
    };
    let center = (Frame::Center, "centre, the reference".to_owned());
    std::iter::once(center).chain(views.iter().map(|view| (Frame::View(view), caption(view)))).collect()
}

/// The name of the scene in `rig.toml`.
const SCENE: &str = "the scene of multiscopic demo";
/// The picture of the truth.
const TRUTH_PNG: &str = "truth.png";
const CLOUD: &str = "cloud.ply";
const OVERVIEW: &str = "overview.png";
const SHEET: &str = "views.svg";
const OVER_VIEWS: &str = "errors-over-views.svg";
const OVER_BASELINES: &str = "errors-over-baselines.svg";
const PAGE: &str = "index.html";

/// The greatest width of each of the overview's five pictures.
const OVERVIEW_PANEL: u32 = 360;
/// The greatest width of the pictures in the sheet.
const SHEET_PANEL: u32 = 168;

/// A folder in which every result can be written.
pub struct ResultsFolder {
    path: PathBuf,
    /// True if it is made together with its files.
    is_new: bool,
    /// All views of the capture.
    views: Views,
}

impl ResultsFolder {
    /// Checks that the results of `variants`, which are captured in `views`, can be written to the folder `path`, or that it can
    /// be made. They replace those of an earlier demo, but no files of the user.
    pub fn check(path: &Path, views: Views, variants: &[Variant]) -> Result<ResultsFolder> {
        let folder = ResultsFolder { path: path.into(), is_new: !path.exists(), views };
        if folder.is_new {
            let parent = path.parent().unwrap_or(path);
            fs::create_dir_all(parent).map_err(|source| Error::Write { path: path.into(), source })?;
            output::check_folder(path)?;
            return Ok(folder);
        }
        let maps = variants.iter().map(variants::stem).flat_map(|stem| [map_pfm(&stem), map_png(&stem), errors_png(&stem)]);
        let single = [Rig::FILE_NAME, TRUTH_FILE_NAME, TRUTH_PNG, CLOUD, OVERVIEW, SHEET, OVER_VIEWS, OVER_BASELINES, PAGE]
            .map(String::from);
        let frames = frames(views).into_iter().map(|(frame, _)| FrameFiles::name_of(frame));
        let paths: Vec<PathBuf> = frames.chain(single).chain(maps).map(|name| folder.file(&name)).collect();
        output::check(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[])?;
        if let Some(path) = paths.iter().find(|path| path.exists())
            && !folder.is_of_a_demo()
        {
            let path = path.display();
            return Err(Error::Usage(format!(
                "{path} is there already, and is not of a demo: give another folder, or remove it"
            )));
        }
        Ok(folder)
    }

    /// Returns true if an earlier demo has written the results that are there, or was killed while it did.
    fn is_of_a_demo(&self) -> bool {
        let rig = self.file(Rig::FILE_NAME);
        let tells = |path: &Path| input::read_text(path).is_ok_and(|rig| rig.contains(SCENE));
        tells(&rig) || (!rig.exists() && tells(&output::broken_seal(&rig)))
    }

    /// Writes all that `contents` writes to the folder that it is given, or nothing. Returns the path of the page.
    ///
    /// A folder without a `rig.toml` is incomplete.
    pub fn write(&self, contents: impl FnOnce(&ResultsFolder) -> Result<()>) -> Result<PathBuf> {
        match self.is_new {
            true => output::write_folder(&self.path, |path| contents(&ResultsFolder { path: path.into(), ..*self }))?,
            false => output::replace_together(&self.file(Rig::FILE_NAME), || contents(self))?,
        }
        Ok(self.file(PAGE))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Writes the frames and `rig.toml`, as after a capture, and the truth.
    pub fn write_capture(&self, shot: &Shot, camera: &PinholeCamera, seed: u64) -> Result<()> {
        scene::write_capture(&self.path, shot, camera, format!("{SCENE}, seed {seed}"))
    }

    /// Writes the maps of all variants, their pictures and errors, the overview, what each set of views adds, and the best
    /// map's point cloud. The first `block_matched` outcomes are those of block matching.
    pub fn write_maps(&self, shot: &Shot, camera: &PinholeCamera, outcomes: &[Outcome], block_matched: usize) -> Result<()> {
        let truth = DisparityMap::from_float(&shot.truth);
        let range = truth.range();
        let color = |map: &DisparityMap| multiscopic::images::turbo(map, range.clone());
        write_png(&self.file(TRUTH_PNG), &color(&truth))?;
        let mut columns = Vec::new();
        for Outcome { variant, disparities, record, .. } in outcomes {
            let stem = &variants::stem(variant);
            let errors = error_map::draw(disparities.pixels().iter().map(|d| d.map(f32::from)), &shot.truth);
            multiscopic::files::write_pfm(&disparities.to_float(), &self.file(&map_pfm(stem)))?;
            write_png(&self.file(&map_png(stem)), &color(disparities))?;
            write_png(&self.file(&errors_png(stem)), &errors)?;
            if variants::is_default(variant) {
                let note = format!("AvgErr {:.3}", record.metrics.avg_err);
                columns.push(PictureColumn {
                    heading: match variant.method {
                        MethodName::Bm => variants::heading(variant),
                        _ => variants::label(variant),
                    },
                    pictures: vec![color(disparities), errors],
                    note,
                });
            }
        }
        let sheet = contact_sheet(&columns, SHEET_PANEL);
        output::write(&self.file(SHEET), |writer| writer.write_all(sheet.as_bytes()))?;
        let [Outcome { disparities: stereo, .. }, .., Outcome { disparities: fused, .. }] = &outcomes[..block_matched] else {
            unreachable!("there are several variants")
        };
        let error = |outcome: &Outcome| outcome.record.metrics.avg_err;
        let best = outcomes.iter().min_by(|a, b| error(a).total_cmp(&error(b))).expect("there are several variants");
        let center = Picture::Rgb(shot.center.clone());
        let size = [camera.width as usize, camera.height as usize];
        let geometry = scene::rig(camera, self.views, String::new()).geometry(size).expect("the camera is known");
        let cloud = Cloud::new(&best.disparities, &center, &geometry);
        ply::write(&self.file(CLOUD), &cloud, Encoding::Binary)?;
        let panels = [&shot.center, &color(stereo), &color(fused), &color(&best.disparities), &color(&truth)];
        write_png(&self.file(OVERVIEW), &montage::row(panels, OVERVIEW_PANEL))
    }

    /// Writes the charts that there are.
    pub fn write_charts(&self, errors: &Errors) -> Result<()> {
        let charts = [(OVER_VIEWS, errors.over_views()), (OVER_BASELINES, errors.over_baselines())];
        for (name, chart) in charts.into_iter().filter_map(|(name, chart)| Some((name, chart?))) {
            output::write(&self.file(name), |writer| writer.write_all(chart.to_svg().as_bytes()))?;
        }
        Ok(())
    }

    /// Writes the page.
    pub fn write_page(&self, html: &str) -> Result<()> {
        output::write(&self.file(PAGE), |writer| writer.write_all(html.as_bytes()))
    }
}

/// The file of a variant's disparities.
pub fn map_pfm(stem: &str) -> String {
    format!("{stem}.pfm")
}

/// The file of a variant's coloured map.
fn map_png(stem: &str) -> String {
    format!("{stem}.png")
}

/// The file of a variant's errors.
fn errors_png(stem: &str) -> String {
    format!("{stem}-errors.png")
}

/// The estimates of a variant, and their accuracy.
pub struct Outcome {
    /// The variant.
    pub variant: Variant,
    /// The method with its parameters.
    pub method: Method,
    /// The range that it searched.
    pub search: SearchSpace,
    /// The estimate.
    pub disparities: DisparityMap,
    /// Its confidences.
    pub confidences: ConfidenceMap,
    /// The errors.
    pub record: Record,
}

const ABOUT_THE_SCENE: &str = "The views are ray-traced: a still life on a brushed metal table, 0.4 m to 2.1 m from the camera. \
                               It contains what makes matching hard: stems thinner than a block, a blank canvas on the wall, \
                               reflections that move with the camera, repeated patterns, slanted and curved surfaces. The sensor \
                               is noisy, and the stage misses its positions by up to 0.1 mm. The truth is exact: the depth at \
                               which the ray through the middle of each pixel meets a surface.";

const REPRODUCE: &str = "The first command makes this page and its files. The second matches the captured folder, as it would a \
                         real one.";

/// The contents of the page.
pub struct ResultsPage<'a> {
    /// The commands that make the results again.
    pub commands: &'a str,
    /// All views of the capture.
    pub views: Views,
    /// The variants that are compared, and their accuracy.
    pub errors: &'a Errors<'a>,
    /// The parameters of the first variant; all variants share range and block.
    pub params: &'a BlockMatchingParams,
    /// The maps and pictures to look at.
    pub scene: &'a ViewedScene,
    /// The measurement with the fewest errors.
    pub best: &'a Record,
    /// The other methods that are shown.
    pub others: &'a [Variant],
    /// The rows of the table.
    pub rows: &'a [ResultRow],
}

impl ResultsPage<'_> {
    /// The page in HTML.
    pub fn to_html(&self) -> String {
        let ResultsPage { params, errors: Errors { variants, .. }, .. } = self;
        let map = |variant: &Variant| Figure::linked(caption(variant), map_png(&stem(variant)));
        let error_map = |variant: &Variant| Figure::linked(caption(variant), errors_png(&stem(variant)));
        let truth = Figure::linked("truth", TRUTH_PNG);
        let block_size = params.block_size();
        let pictures = frames(self.views).into_iter().map(|(frame, caption)| Figure::linked(caption, FrameFiles::name_of(frame)));
        let title = if self.views == Views::CROSS { "The five views".into() } else { format!("The {} views", pictures.len()) };
        let page = Report::new("Depth from one camera that moves")
            .paragraph(&self.summary())
            .viewer(self.commands.lines().next().unwrap_or_default(), std::slice::from_ref(self.scene))
            .heading("Errors")
            .table(ResultRow::HEADINGS, self.rows.iter().map(ResultRow::cells))
            .paragraph(&format!(
                "Disparities from {} to {}, blocks of {block_size} x {block_size}. RMS and AvgErr are in pixels, with the \
                 change from stereo in brackets; the other columns are percentages of pixels.",
                params.min_disparity(),
                params.max_disparity()
            ));
        self.errors
            .charts()
            .iter()
            .fold(page, Report::chart)
            .gallery(&title, pictures)
            .paragraph(ABOUT_THE_SCENE)
            .gallery("Disparities", std::iter::once(truth).chain(variants.iter().chain(self.others).map(map)))
            .paragraph("Red is near, blue is far, black has no disparity. All maps share one colour scale.")
            .gallery("Error maps", variants.iter().chain(self.others).map(error_map))
            .paragraph(&format!("Difference from the truth: {}.", error_map::LEGEND))
            .heading("Reproduce this")
            .paragraph(REPRODUCE)
            .code(self.commands)
            .to_html()
    }

    /// The first and the last record in words, and the best one.
    fn summary(&self) -> String {
        let [stereo, .., last] = self.errors.records else { unreachable!("there are several variants") };
        let accuracy = |record: &Record| {
            let (rms, bad) = (record.metrics.rms, record.metrics.bad_1);
            format!("an RMS error of {rms:.2} px, with {bad:.1} % of the pixels off by more than one")
        };
        let moves = if self.views == Views::CROSS {
            "A camera takes a picture, moves one baseline to the left, to the right, up and down, and takes another each time."
        } else {
            "A camera takes a picture, moves in its image plane by whole baselines, and takes another each time."
        };
        let all = if last.baselines.is_empty() { "at once" } else { "at several baselines" };
        let best = match self.best.method == last.method {
            true => String::new(),
            false => format!(" The best of the methods, {}, has {}.", self.best.method, accuracy(self.best)),
        };
        format!(
            "{moves} Block matching with one neighbour, as in stereo, has {}. With all {} {all}, it has {}.{best}",
            accuracy(stereo),
            last.views,
            accuracy(last)
        )
    }
}
