//! `multiscopic align`: the misalignment of the views.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Alignment, Error, Inspection, Result, Rig,
    alignment::Tolerance,
    files::{FrameFiles, Residual, output},
    images::BitDepth,
};
use multiscopic_core::{Frame, View};
use serde::Serialize;

use super::{
    advice,
    options::{MemoryOptions, SearchOptions, SourceOptions, output_file},
    preparation::check_alignment,
    terminal,
};
use crate::report::{EpipolarMap, Report};

/// Estimates how each view is turned, scaled and off its place, from the images alone, and rectifies them
///
/// Rotations are about the axes to the right, down and ahead. The shift is to the right for views in the centre's column,
/// and downwards across the baseline for others. What is found is taken out in a new folder with -o, or just before matching
/// with `multiscopic match --align`. Only what the images prove is taken out: the rest stays as it is. A view that is off its
/// place is put right for a plane through the scene.
#[derive(Clone, Debug, Args)]
pub struct Align {
    #[command(flatten)]
    source: SourceOptions,

    #[command(flatten)]
    search: SearchOptions,

    /// New folder for the rectified capture, in colour and with 16 bits where the images are
    #[arg(short, long, value_name = "NEW_RIG_DIR")]
    output: Option<PathBuf>,

    /// Page with the matches of each view and their epipolar errors before and after rectification
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html())]
    report: Option<PathBuf>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    memory: MemoryOptions,
}

/// The object that `--json` prints.
#[derive(Debug, Serialize)]
struct Findings {
    /// The rotation between the camera and the stage's axes, about the axes to the right, down and ahead.
    common_rotation_deg: [f64; 3],
    /// Its standard deviations; null where the views do not determine the angle.
    common_rotation_deviation_deg: [f64; 3],
    /// The sentences about the corrections, and about what the images do not show.
    summary: String,
    not_shown: Option<String>,
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
        let reports: Vec<&Path> = self.report.iter().map(PathBuf::as_path).collect();
        output::check(&reports, &source.paths().collect::<Vec<_>>())?;
        if let Some(folder) = &self.output {
            output::check_folder(folder)?;
        }
        let (frames, _, undistortion) = source.load()?;
        let inspection = Inspection::of(&frames);
        let range = inspection.range.unwrap_or(SearchOptions::DEFAULT_RANGE);
        let search = self.search.search(frames.size(), frames.views(), None, range)?;
        let tolerance = source.rig.as_ref().and_then(Tolerance::of_rig);
        let rig = match (source.rig.take(), &source.lens) {
            (Some(rig), Some(lens)) => Some(lens.ideal_rig(rig, frames.size())?),
            // Its images no longer are where the stage put them.
            (Some(rig), None) => Some(Rig { poses: BTreeMap::new(), mount_roll_deg: None, hand_eye: None, ..rig }),
            (None, _) => None,
        };
        let geometry = rig.as_ref().and_then(|rig| rig.geometry(frames.size()));
        check_alignment(&self.memory, &frames)?;
        let alignment = Alignment::estimate_within(&frames, &search, geometry.as_ref(), tolerance);
        // Nobody asked for the negative disparities that the images show.
        let asked = self.search.min_disparity.unwrap_or(0);
        let refuse_swapped = |inspection: &Inspection| inspection.refuse_swapped(asked);
        let alignment = alignment.map_err(|error| refuse_swapped(&inspection).err().unwrap_or(error))?;
        let inspection = alignment.inspect(&inspection, &alignment.compensate(&frames));
        refuse_swapped(&inspection)?;
        let rectified = |frame| Rectified { homography: alignment.homography(frame) };
        let line = |view: View| {
            Some(Line { view: view.to_string(), residual: alignment.of(view)?, rectified: rectified(Frame::View(view)) })
        };
        let record = alignment.record();
        let findings = Findings {
            common_rotation_deg: record.common_rotation_deg,
            common_rotation_deviation_deg: record.common_rotation_deviation_deg,
            summary: alignment.summary(),
            not_shown: alignment.not_shown(),
            center: rectified(Frame::Center),
            views: frames.views().iter().filter_map(line).collect(),
        };
        let written = [self.output.as_ref().filter(|_| rig.is_some()), self.report.as_ref()];
        output::write_together(|| {
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
                    Rig { images, principal_point, alignment: Some(record), ..rig }.save(folder)
                })?;
            }
            if let Some(path) = &self.report {
                let page = findings.page(&alignment, frames.size());
                output::write(path, |writer| writer.write_all(page.as_bytes()))?;
            }
            Ok(())
        })?;
        written.into_iter().flatten().for_each(|path| terminal::say(&format!("wrote {}", path.display())));
        let warnings = inspection.warnings(asked).into_iter().chain(alignment.warning());
        warnings.for_each(|warning| terminal::warn(&advice::warning(&warning)));
        advice::range_line(&inspection).into_iter().for_each(|line| terminal::say(&line));
        terminal::print(&match self.json {
            true => serde_json::to_string(&findings).expect("numbers and strings") + "\n",
            false => findings.table(),
        })?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Findings {
    /// The rotation of the camera against the stage.
    fn common(&self) -> String {
        let [right, down, ahead] = self.common_rotation_deg;
        let deviations = self.common_rotation_deviation_deg.map(|deg| match deg.is_finite() {
            true => format!("{deg:.2}"),
            false => "unknown".into(),
        });
        format!(
            "camera against the stage: {right:+.2} {down:+.2} {ahead:+.2} deg about right, down, ahead, +- {}",
            deviations.join(" ")
        )
    }

    /// A table for people. Below each line are standard deviations.
    fn table(&self) -> String {
        let mut table = [Some(&self.summary), self.not_shown.as_ref(), Some(&self.common())]
            .into_iter()
            .flatten()
            .cloned()
            .collect::<Vec<_>>()
            .join("\n");
        table += "\nview    rotation deg          scale   shift px      across px  baseline  direction deg  brightness  points  ";
        table += "epipolar (Sampson) px before, after\n";
        for Line { view, residual, .. } in &self.views {
            let Residual { rotation_deg: [x, y, z], scale, across_px, baseline_scale, direction_deg, gain, points, .. } =
                residual;
            let Residual { sampson_px, rectified_sampson_px, .. } = residual;
            let [right, down] = residual.shift_px;
            table += &format!("{view:<8}{x:+.2} {y:+.2} {z:+.2}   {scale:>7.4} {right:>+7.2} {down:>+6.2}");
            table += &format!("{across_px:>+12.2}{baseline_scale:>10.4}");
            table += &format!("{direction_deg:>+15.2}{gain:>12.4}{points:>8}{sampson_px:>23.2}{rectified_sampson_px:>7.2}\n");
            let Residual { rotation_deviation_deg: [x, y, z], scale_deviation, baseline_scale_deviation, .. } = residual;
            let Residual { direction_deviation_deg, .. } = residual;
            let [right, down] = residual.shift_deviation_px;
            table += &format!("    +-  {x:>5.3} {y:>5.3} {z:>5.3}   {scale_deviation:>7.4} {right:>7.2} {down:>6.2}");
            table += &format!("{:>12}{baseline_scale_deviation:>10.4}{direction_deviation_deg:>15.2}\n", "");
        }
        table
    }

    /// A page with a picture of the epipolar errors of each view.
    fn page(&self, alignment: &Alignment, size: [usize; 2]) -> String {
        let text = "A stroke leads from each corner of the centre image across the baseline of the view. It is as long as the epipolar \
                    error of the match: how far the corner and its match must move, together, to be on one epipolar line (Sampson, 1982). \
                    In a rig without errors there would be points only.";
        let plus_minus = |value: f64, deviation: f64, decimals: usize| format!("{value:.decimals$} ± {deviation:.decimals$}");
        let row = |Line { view, residual, .. }: &Line| {
            let Residual { rotation_deg, rotation_deviation_deg, scale, scale_deviation, baseline_scale, .. } = *residual;
            let Residual { baseline_scale_deviation, direction_deg, direction_deviation_deg, across_px, gain, .. } = *residual;
            let [x, y, z] = [0, 1, 2].map(|axis| plus_minus(rotation_deg[axis], rotation_deviation_deg[axis], 3));
            let baseline = plus_minus(baseline_scale, baseline_scale_deviation, 4);
            let direction = plus_minus(direction_deg, direction_deviation_deg, 2);
            let scale = plus_minus(scale, scale_deviation, 4);
            let [right, down] = [0, 1].map(|axis| plus_minus(residual.shift_px[axis], residual.shift_deviation_px[axis], 2));
            let [across, gain] = [format!("{across_px:.2}"), format!("{gain:.4}")];
            let [before, after] = [residual.sampson_px, residual.rectified_sampson_px].map(|px| format!("{px:.2}"));
            [
                view.clone(),
                x,
                y,
                z,
                scale,
                right,
                down,
                across,
                baseline,
                direction,
                gain,
                residual.points.to_string(),
                before,
                after,
            ]
        };
        let headers = [
            "view",
            "about right deg",
            "about down deg",
            "about ahead deg",
            "scale",
            "shift right px",
            "shift down px",
            "across px",
            "baseline",
            "direction deg",
            "brightness",
            "matches",
            "Sampson px before",
            "after",
        ];
        let page = Report::new("Alignment of views").paragraph(text);
        let page = alignment.views().iter().fold(page, |page, view| page.epipolar_errors(&EpipolarMap { alignment, view, size }));
        let sentences = [Some(self.summary.clone()), self.not_shown.clone(), Some(self.common())];
        let common = sentences.into_iter().flatten().map(|sentence| sentence + ". ").collect::<String>();
        page.heading("Estimates").paragraph(common.trim_end()).table(headers, self.views.iter().map(row)).to_html()
    }
}
