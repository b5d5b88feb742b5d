//! `multiscopic rig import`: photos whose places are known.

use std::{collections::BTreeMap, path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Result, Rig,
    files::{FrameFiles, FramePose, PhotoGrid, PhotoLine, PosedPhoto, Provenance, SweepFrame},
    lens::read_colmap,
};
use multiscopic_core::{Frame, View};

use super::camera_options::CameraOptions;
use crate::command::{options::value::positive, terminal};

/// Writes the rig.toml of photos whose places are known
///
/// The photo in the middle becomes the centre, and the others its views: they must stand at whole multiples of a baseline to its
/// right, left, top or bottom, and look the same way. Photos to its left and right alone may stand at any distances: they become the
/// frames of a sweep.
#[derive(Clone, Debug, Args)]
pub struct Import {
    /// Folder of the photos
    #[arg(value_name = "DIR")]
    directory: PathBuf,

    /// Table of the photos and their places in millimetres: columns name,x_mm,y_mm, and perhaps z_mm, or z_mm,rx_deg,ry_deg,rz_deg
    /// (an axis times an angle). Without angles, x points to the right of the images and y down
    #[arg(long, value_name = "FILE.csv", required_unless_present = "colmap", conflicts_with = "colmap")]
    positions: Option<PathBuf>,

    /// Folder with the cameras.txt and images.txt of COLMAP, whose places have no millimetres: depth needs --baseline-mm
    #[arg(long, value_name = "DIR", conflicts_with_all = ["lens", "focal_px", "principal_point"])]
    colmap: Option<PathBuf>,

    /// Photo that becomes the centre [default: the one in the middle of all]
    #[arg(long, value_name = "NAME")]
    center: Option<PathBuf>,

    /// Distance from the centre to its nearest neighbours, in millimetres [default: what fits --positions best]
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    #[command(flatten)]
    camera: CameraOptions,
}

impl Import {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let (photos, calibration, baseline) = match (&self.positions, &self.colmap) {
            (_, Some(folder)) => {
                let (photos, camera) = read_colmap(folder)?;
                (photos, Some(camera), None)
            }
            (Some(table), None) => (PosedPhoto::read_table(table)?, self.camera.calibration()?, self.baseline_mm),
            (None, None) => unreachable!("clap asks for one of them"),
        };
        self.camera.check_folder(&self.directory, calibration.is_some())?;
        let source = self.positions.as_ref().or(self.colmap.as_ref()).map(|path| path.display().to_string()).unwrap_or_default();
        let capture = Provenance { notes: Some(format!("imported from {source}")), ..Provenance::default() };
        let center = self.center.as_deref();
        let grid = match PhotoGrid::of(&photos, center, baseline) {
            Ok(grid) => grid,
            // Only millimetres without a unit of their own are those of a sweep.
            Err(error) if self.positions.is_some() && baseline.is_none() => {
                let line = PhotoLine::of(&photos, center)?.ok_or(error)?;
                return self.camera.write(&self.directory, Rig { capture, ..sweep(line) }, calibration);
            }
            Err(error) => return Err(error),
        };
        let baseline_mm = self.baseline_mm.or(self.positions.as_ref().map(|_| grid.baseline));
        let known = Rig {
            baseline_mm,
            poses: baseline_mm.map_or_else(BTreeMap::new, |baseline_mm| poses(&grid, baseline_mm)),
            capture,
            ..Rig::of_pair(None, grid.images.clone())
        };
        terminal::say(&format!(
            "places: at most {:.1} % of the baseline from whole multiples; `match --align` takes out what remains",
            100.0 * grid.deviation()
        ));
        self.camera.write(&self.directory, known, calibration)
    }
}

/// The rig of a sweep.
fn sweep(line: PhotoLine) -> Rig {
    let farthest = line.frames.iter().map(|(_, right)| right.abs()).fold(0.0, f64::max);
    let frames = line.frames.into_iter().map(|(image, offset_mm)| SweepFrame { image, offset_mm, exposed: None });
    let images = FrameFiles { center: line.center, ..FrameFiles::default() };
    Rig { baseline_mm: Some(farthest), sweep: frames.collect(), ..Rig::of_pair(None, images) }
}

/// The places where the views should stand, and where they do, in the plane of the centre's image.
fn poses(grid: &PhotoGrid, baseline_mm: f64) -> BTreeMap<String, FramePose> {
    let pose = |(view, place): (&View, &[f64; 2])| {
        let asked_mm = [view.right(), view.down()].map(|multiple| f64::from(multiple) * baseline_mm);
        let counted_mm = Some(place.map(|multiple| multiple * baseline_mm));
        (Frame::View(*view).to_string(), FramePose { asked_mm, counted_mm, exposed: None, measured: None })
    };
    grid.places.iter().map(pose).collect()
}
