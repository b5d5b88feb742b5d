//! `multiscopic align`: the misalignment of the views.

use std::{path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Alignment, Error, Frames, Inspection, Result, Rig,
    alignment::Residual,
    files::{FrameFiles, output},
    images::BitDepth,
};
use multiscopic_core::{Frame, View};
use serde::Serialize;

use super::{
    options::{SearchOptions, SourceOptions},
    terminal,
};

/// Estimates how each view is turned, scaled and off its place, from the images alone, and rectifies them
///
/// Rotations are about the axes to the right, down and ahead. The shift is to the right for views in the centre's column,
/// and downwards across the baseline for others. What is found is taken out in a new folder with -o, or just before matching
/// with `multiscopic match --align`. A view that is off its place is put right for a plane through the scene.
#[derive(Clone, Debug, Args)]
pub struct Align {
    #[command(flatten)]
    source: SourceOptions,

    #[command(flatten)]
    search: SearchOptions,

    /// New folder for the rectified capture, in colour and with 16 bits where the images are
    #[arg(short, long, value_name = "NEW_RIG_DIR")]
    output: Option<PathBuf>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    /// The rotation between the camera and the stage's axes, about the axes to the right, down and ahead.
    common_rotation_deg: [f64; 3],
    center: Rectified,
    views: Vec<Line>,
}

/// From pixels of a rectified frame to those of its image.
#[derive(Debug, Serialize)]
struct Rectified {
    homography: [[f64; 3]; 3],
}

/// A line of the table.
#[derive(Debug, Serialize)]
struct Line {
    view: String,
    #[serde(flatten)]
    residual: Residual,
    #[serde(flatten)]
    rectified: Rectified,
}

impl Align {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let Some(mut source) = self.source.source()? else {
            let message = "there are no images to align: give RIG_DIR, a folder with a rig.toml, or --center and its neighbours";
            return Err(Error::Usage(message.into()));
        };
        if self.output.is_some() && source.rig.is_none() {
            let message = "-o writes a folder with a rig.toml, which only a captured folder can provide: give RIG_DIR";
            return Err(Error::Usage(message.into()));
        }
        let (frames, _, undistortion) = source.load()?;
        let search = self.search.search(frames.size(), frames.views(), None, SearchOptions::DEFAULT_RANGE)?;
        let rig = match (source.rig.take(), &source.lens) {
            (Some(rig), Some(lens)) => Some(lens.ideal_rig(rig, frames.size())?),
            (rig, _) => rig,
        };
        let geometry = rig.as_ref().and_then(|rig| rig.geometry(frames.size()));
        let refuse_swapped = |frames: &Frames| {
            let inspection = Inspection::of(frames);
            inspection.refuse_swapped(search.min_disparity()).map(|()| inspection)
        };
        let alignment = match Alignment::estimate(&frames, &search, geometry.as_ref()) {
            Err(error) => return Err(refuse_swapped(&frames).err().unwrap_or(error)),
            Ok(alignment) => alignment,
        };
        // Views that are turned away from their baselines look swapped until they are rectified.
        let inspection = refuse_swapped(&alignment.compensate(&frames))?;
        let rectified = |frame| Rectified { homography: alignment.homography(frame) };
        let line = |view: View| {
            Some(Line { view: view.to_string(), residual: alignment.of(view)?, rectified: rectified(Frame::View(view)) })
        };
        let report = Report {
            common_rotation_deg: alignment.common_rotation_deg(),
            center: rectified(Frame::Center),
            views: frames.views().iter().filter_map(line).collect(),
        };
        if let (Some(folder), Some(rig)) = (&self.output, rig) {
            output::write_folder(folder, |folder| {
                let mut images = FrameFiles::of_capture(frames.views());
                for rectified in source.rectified(undistortion.as_ref(), &alignment) {
                    let (frame, picture) = rectified?;
                    if picture.has_16_bits() {
                        images.bits = Some(BitDepth::Sixteen);
                    }
                    picture.write_png(&folder.join(FrameFiles::name_of(frame)))?;
                }
                let principal_point = Some(alignment.principal_point(rig.principal_point(frames.size())));
                Rig { images, principal_point, ..rig }.save(folder)
            })?;
            terminal::say(&format!("wrote {}", folder.display()));
        }
        alignment.warning().into_iter().for_each(|warning| terminal::say(&format!("warning: {warning}")));
        inspection.range_line().into_iter().for_each(|line| terminal::say(&line));
        terminal::print(&match self.json {
            true => serde_json::to_string(&report).expect("numbers and strings") + "\n",
            false => table(&report),
        })?;
        Ok(ExitCode::SUCCESS)
    }
}

fn table(report: &Report) -> String {
    let [right, down, ahead] = report.common_rotation_deg;
    let mut table = format!("camera against the stage: {right:+.2} {down:+.2} {ahead:+.2} deg about right, down, ahead\n");
    table +=
        "view    rotation deg          scale   across px  baseline  direction deg  brightness  points  off px  rectified px\n";
    for Line { view, residual, .. } in &report.views {
        let Residual { rotation_deg: [x, y, z], scale, across_px, baseline_scale, direction_deg, gain, points, .. } = residual;
        let Residual { epipolar_px, rectified_px, .. } = residual;
        table += &format!("{view:<8}{x:+.2} {y:+.2} {z:+.2}   {scale:>7.4}{across_px:>+12.2}{baseline_scale:>10.4}");
        table += &format!("{direction_deg:>+15.2}{gain:>12.4}{points:>8}{epipolar_px:>8.2}{rectified_px:>14.2}\n");
    }
    table
}
