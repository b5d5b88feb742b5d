//! The folder of results: a capture as a rig would leave it, the truth, the maps, and the page.

use std::{
    fs,
    path::{Path, PathBuf},
};

use multiscopic::{
    DisparityMap, Error, Picture, Result, Rig,
    files::{
        FrameFiles, Provenance,
        image_codec::write_png,
        output,
        ply::{self, Encoding},
    },
    report::{error_map, montage},
    scene::{PinholeCamera, Shot},
};
use multiscopic_core::{Frame, View, Views};

use super::{
    outcome::Outcome,
    variants::{self, VARIANTS},
};

/// The frames, with their captions.
pub const FRAMES: [(Frame, &str); 5] = [
    (Frame::Center, "centre, the reference"),
    (Frame::View(View::LEFT), "left"),
    (Frame::View(View::RIGHT), "right"),
    (Frame::View(View::TOP), "top"),
    (Frame::View(View::BOTTOM), "bottom"),
];

/// The picture of the truth.
pub const TRUTH_PNG: &str = "truth.png";
const TRUTH_PFM: &str = "truth.pfm";
const CLOUD: &str = "cloud.ply";
const OVERVIEW: &str = "overview.png";
const PAGE: &str = "index.html";

/// The greatest width of each of the overview's four pictures.
const OVERVIEW_PANEL: u32 = 360;

/// A folder in which every result can be written.
pub struct ResultsFolder(PathBuf);

impl ResultsFolder {
    /// Creates the folder if it is missing, and checks that the results can be written to it.
    pub fn create(path: &Path) -> Result<ResultsFolder> {
        fs::create_dir_all(path).map_err(|source| Error::Write { path: path.into(), source })?;
        let folder = ResultsFolder(path.into());
        let maps = VARIANTS.iter().map(variants::stem).flat_map(|stem| [map_pfm(&stem), map_png(&stem), errors_png(&stem)]);
        let single = [Rig::FILE_NAME, TRUTH_PFM, TRUTH_PNG, CLOUD, OVERVIEW, PAGE].map(String::from);
        let frames = FRAMES.map(|(frame, _)| FrameFiles::name_of(frame));
        let paths: Vec<PathBuf> = frames.into_iter().chain(single).chain(maps).map(|name| folder.path(&name)).collect();
        output::check(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[])?;
        Ok(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes the frames and `rig.toml`, as after a capture, and the truth.
    pub fn write_capture(&self, shot: &Shot, camera: &PinholeCamera, seed: u64) -> Result<()> {
        for (frame, _) in FRAMES {
            write_png(&self.path(&FrameFiles::name_of(frame)), shot.frame(frame))?;
        }
        rig(camera, seed).save(&self.0)?;
        shot.truth.write_pfm(&self.path(TRUTH_PFM))
    }

    /// Writes the maps of all variants, their pictures and errors, the overview, and the best map's point cloud.
    pub fn write_maps(&self, shot: &Shot, camera: &PinholeCamera, outcomes: &[Outcome]) -> Result<()> {
        let truth = DisparityMap::from_float(&shot.truth);
        let range = truth.range();
        let color = |map: &DisparityMap| map.to_color(range.clone());
        write_png(&self.path(TRUTH_PNG), &color(&truth))?;
        for Outcome { stem, disparities, .. } in outcomes {
            let errors = error_map::draw(disparities.pixels().iter().map(|d| d.map(f32::from)), &shot.truth);
            disparities.write_pfm(&self.path(&map_pfm(stem)))?;
            write_png(&self.path(&map_png(stem)), &color(disparities))?;
            write_png(&self.path(&errors_png(stem)), &errors)?;
        }
        let [Outcome { disparities: stereo, .. }, .., Outcome { disparities: best, .. }] = outcomes else {
            unreachable!("there are several variants")
        };
        let center = Picture::Rgb(shot.center.clone());
        let geometry = rig(camera, 0).geometry().expect("the camera has a focal length");
        ply::write(&self.path(CLOUD), best, &geometry, &center, Encoding::Binary)?;
        let panels = [&shot.center, &color(stereo), &color(best), &color(&truth)];
        write_png(&self.path(OVERVIEW), &montage::row(panels, OVERVIEW_PANEL))
    }

    /// Writes the page and returns its path.
    pub fn write_page(&self, html: &str) -> Result<PathBuf> {
        let path = self.path(PAGE);
        output::write(&path, |writer| writer.write_all(html.as_bytes()))?;
        Ok(path)
    }
}

fn map_pfm(stem: &str) -> String {
    format!("{stem}.pfm")
}

/// The file of a variant's coloured map.
pub fn map_png(stem: &str) -> String {
    format!("{stem}.png")
}

/// The file of a variant's errors.
pub fn errors_png(stem: &str) -> String {
    format!("{stem}-errors.png")
}

/// The rig of the rendered capture.
fn rig(camera: &PinholeCamera, seed: u64) -> Rig {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    Rig {
        baseline_mm: camera.baseline_mm,
        focal_px: Some(camera.focal_px),
        principal_point: [middle(camera.width), middle(camera.height)],
        doffs: 0.0,
        images: FrameFiles::of_capture(Views::CROSS),
        capture: Provenance {
            camera: Some("ray tracer".into()),
            stage: Some("simulated".into()),
            repeatability_mm: Some(camera.repeatability_mm),
            notes: Some(format!("the scene of multiscopic demo, seed {seed}")),
            ..Provenance::default()
        },
    }
}
