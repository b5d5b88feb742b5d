//! The outputs of `multiscopic match`.

use std::path::{Path, PathBuf};
#[cfg(feature = "mcap")]
use std::time::{SystemTime, UNIX_EPOCH};

use clap::Args;
#[cfg(feature = "mcap")]
use multiscopic::files::ros::{RosRecording, check_rerun};
use multiscopic::{
    DisparityMap, Error, FloatImage, Geometry, Picture, Result,
    files::{
        Cloud,
        ply::{self, Encoding},
    },
    images::{ColorScale, FrameTree, PointFrame},
    stereo::confidence_map::ConfidenceMap,
};

#[cfg(feature = "mcap")]
use multiscopic_core::SearchSpace;

use crate::command::options::{MapFiles, named, output_file};

/// The files that the command writes.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct Outputs {
    #[command(flatten)]
    pub maps: MapFiles,

    /// Confidences as an 8-bit image: the probability that a disparity is at most one pixel off, times 255, 0 where invalid
    #[arg(long, value_name = "OUT.png", conflicts_with = "prior", value_parser = output_file::png())]
    pub confidence: Option<PathBuf>,

    /// Depth in metres, +inf where unknown, as PFM or for numpy (OUT.npy, OUT.npz); or in millimetres as a 16-bit image, 0 where
    /// unknown (OUT.png); needs the focal length and the baseline
    #[arg(long, value_name = "OUT.pfm", value_parser = output_file::depths())]
    depth: Option<PathBuf>,

    /// Standard deviation of depth in millimetres, +inf where unknown: the truth is within twice that for 95 % of the points; needs
    /// the focal length and the baseline; not for mccnn
    #[arg(long, value_name = "OUT.pfm", conflicts_with = "prior", value_parser = output_file::floats())]
    pub sigma: Option<PathBuf>,

    /// Depth in colour, with the colours of --png; the nearest and the farthest hundredth are clamped
    #[arg(long, value_name = "OUT.png", value_parser = output_file::png())]
    depth_png: Option<PathBuf>,

    /// Inputs of the network of --method net, made from the images, as a folder of arrays for numpy: train/README.md tells what
    /// they are
    #[arg(long, value_name = "DIR")]
    pub features: Option<PathBuf>,

    /// Draw the disparities in the terminal as well
    #[arg(long)]
    pub preview: bool,

    /// Print the summary as one JSON object on standard output
    #[arg(long)]
    pub json: bool,

    /// Coloured point cloud in metres, with confidences if --confidence is given, with standard deviations if --sigma is; needs the focal length and the baseline
    #[arg(long, value_name = "OUT.ply", value_parser = output_file::ply())]
    pub ply: Option<PathBuf>,

    /// Frame of coordinates of the points of --ply and --mcap
    #[arg(long, value_parser = named::<PointFrame>(), default_value = PointFrame::Camera.name())]
    frame: PointFrame,

    /// Place of the camera on the tool of an arm, as `multiscopic calibrate hand-eye` finds it [default: that of rig.toml]
    #[arg(long, value_name = "FILE.toml")]
    pub hand_eye: Option<PathBuf>,

    /// Recording for ROS 2 and Foxglove: depth, camera, points, disparities with all their fields, confidences; needs the focal
    /// length and the baseline
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "OUT.mcap", value_parser = output_file::mcap())]
    mcap: Option<PathBuf>,

    /// The same as a file of Rerun, whose program `rerun` converts it: install it with `pip install rerun-sdk`
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "OUT.rrd", value_parser = output_file::rrd())]
    rerun: Option<PathBuf>,

    /// Page to look at the disparities, the pictures, the costs and the points, see `multiscopic view`
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html())]
    pub report: Option<PathBuf>,

    /// Write the point cloud as text instead of binary
    #[arg(long, requires = "ply")]
    ply_ascii: bool,
}

/// The findings of a match, which the files have.
#[derive(Clone, Copy, Debug)]
pub struct Findings<'a> {
    /// The disparities.
    pub disparities: &'a DisparityMap,
    /// Their confidences, if they were computed.
    pub confidences: Option<&'a ConfidenceMap>,
    /// The standard deviations of the depths in metres, if they are known.
    pub deviations: Option<&'a FloatImage>,
    /// The camera, if it is known.
    pub geometry: Option<&'a Geometry>,
    /// The points, if an output has them.
    pub cloud: Option<Cloud<'a>>,
}

impl Outputs {
    /// Refuses to match for nothing, for a program that is missing, and two things on standard output.
    pub fn check(&self) -> Result<()> {
        #[cfg(feature = "mcap")]
        if self.rerun.is_some() {
            check_rerun()?;
        }
        let is_printed = self.maps.check_printed(&[("--preview", self.preview), ("--json", self.json)])?;
        if is_printed || !self.paths().is_empty() || self.features.is_some() {
            return Ok(());
        }
        let message = "there is nothing to write: give -o OUT.pfm, or another output such as --png OUT.png, --preview or --json";
        Err(Error::Usage(message.into()))
    }

    pub fn paths(&self) -> Vec<&Path> {
        let Outputs { maps, confidence, depth, sigma, depth_png, ply, report, .. } = self;
        maps.paths()
            .chain([confidence, depth, sigma, depth_png, ply, report].into_iter().flatten().map(PathBuf::as_path))
            .chain(self.recordings().into_iter().map(|(_, path)| path))
            .collect()
    }

    /// These outputs in a folder, where a name of each is given.
    pub fn within(&self, folder: &Path) -> Result<Outputs> {
        let mut outputs = self.clone();
        let Outputs {
            maps,
            confidence,
            depth,
            sigma,
            depth_png,
            ply,
            report,
            #[cfg(feature = "mcap")]
            mcap,
            #[cfg(feature = "mcap")]
            rerun,
            ..
        } = &mut outputs;
        #[cfg(feature = "mcap")]
        let recordings = [mcap, rerun];
        #[cfg(not(feature = "mcap"))]
        let recordings: [&mut Option<PathBuf>; 0] = [];
        let paths = [confidence, depth, sigma, depth_png, ply, report].into_iter().chain(recordings).flatten();
        for path in maps.paths_mut().chain(paths) {
            if output_file::is_standard_output(path) || path.file_name() != Some(path.as_os_str()) {
                return Err(Error::Usage(format!(
                    "the output {} is not a name alone: with --list, outputs are in the folder of each rig in --results",
                    path.display()
                )));
            }
            *path = folder.join(&*path);
        }
        Ok(outputs)
    }

    pub fn write(&self, findings: &Findings) -> Result<()> {
        let Findings { disparities, confidences, deviations, geometry, cloud } = *findings;
        self.maps.write(disparities)?;
        if let (Some(path), Some(confidences)) = (&self.confidence, confidences) {
            Picture::from(confidences).write_png(path)?;
        }
        if let (Some(path), Some(geometry)) = (&self.depth, geometry) {
            match output_file::ends_in(path, "png") {
                true => multiscopic::files::write_depth_mm(disparities, geometry, path)?,
                false => output_file::write_floats(&geometry.depths(disparities), path, "depth")?,
            }
        }
        if let (Some(path), Some(deviations)) = (&self.sigma, deviations) {
            output_file::write_floats(&deviations.map(|metres| 1000.0 * metres), path, "sigma")?;
        }
        if let (Some(path), Some(geometry)) = (&self.depth_png, geometry) {
            let depth = geometry.depths(disparities);
            self.maps.draw(&depth, &ColorScale::of_depth(self.maps.colormap(), &depth)).write_png(path)?;
        }
        if let (Some(path), Some(cloud)) = (&self.ply, cloud) {
            let encoding = if self.ply_ascii { Encoding::Ascii } else { Encoding::Binary };
            let confidences = confidences.filter(|_| self.confidence.is_some());
            let deviations = deviations.filter(|_| self.sigma.is_some());
            ply::write(path, &Cloud { confidences, deviations, ..cloud }, encoding)?;
        }
        Ok(())
    }

    /// Writes the recordings that were asked for, of a centre that was exposed at a time.
    #[cfg(feature = "mcap")]
    pub fn record(&self, search: &SearchSpace, findings: &Findings, exposed: SystemTime) -> Result<()> {
        let Some(cloud) = findings.cloud else { return Ok(()) };
        let recording = RosRecording { cloud, range: [search.min_disparity(), search.max_disparity()] };
        let time = exposed.duration_since(UNIX_EPOCH).unwrap_or_default();
        self.mcap.iter().try_for_each(|path| recording.write(path, time))?;
        self.rerun.iter().try_for_each(|path| recording.write_rerun(path, time))
    }

    /// The frame of the points.
    ///
    /// # Errors
    /// It is not known where it is. The message says what to give.
    pub fn frame(&self, frames: &FrameTree) -> Result<PointFrame> {
        let name = self.frame.name();
        if self.frame != PointFrame::Camera && frames.camera_in_tool.is_none() {
            return Err(Error::Usage(format!(
                "--frame {name} needs to know where the camera sits on the tool: give --hand-eye hand_eye.toml, which `multiscopic \
                 calibrate hand-eye` writes"
            )));
        }
        if self.frame == PointFrame::Base && frames.tool_in_base.is_none() {
            return Err(Error::Usage(format!(
                "--frame {name} needs the pose of the tool when the centre was taken, which the images do not have: give a folder that \
                 `multiscopic capture` took with an arm, whose rig.toml has it as [poses.center.measured]"
            )));
        }
        Ok(self.frame)
    }

    /// The recordings, with their options.
    fn recordings(&self) -> Vec<(&'static str, &Path)> {
        #[cfg(feature = "mcap")]
        let recordings = [("--mcap", &self.mcap), ("--rerun", &self.rerun)];
        #[cfg(not(feature = "mcap"))]
        let recordings: [(_, &Option<PathBuf>); 0] = [];
        recordings.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?))).collect()
    }

    /// Returns true if an output has confidences.
    pub fn has_confidences(&self) -> bool {
        self.confidence.is_some() || self.report.is_some() || !self.recordings().is_empty()
    }

    /// Returns true if an output has the colours of the centre.
    pub fn has_center(&self) -> bool {
        self.ply.is_some() || !self.recordings().is_empty()
    }

    /// The option and the file of an output that needs the geometry, if there is one.
    pub fn of_depth(&self) -> Option<String> {
        let outputs =
            [("--depth", &self.depth), ("--sigma", &self.sigma), ("--depth-png", &self.depth_png), ("--ply", &self.ply)];
        let outputs = outputs.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?)));
        outputs.chain(self.recordings()).next().map(|(option, path)| format!("{option} {}", path.display()))
    }
}
