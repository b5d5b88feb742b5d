//! The references that captured folders are compared with, and how both are read.

use std::path::{Path, PathBuf};

use clap::Args;
use multiscopic::{
    Error, FloatImage, Frames, Geometry, MatchSetup, Result, Rig, evaluation::ground_truth, images::ImageRegion,
    lens::Undistortion,
};

use crate::command::{
    limits::limits,
    options::{BitsOption, GeometryOptions, MemoryOptions, PreparationOptions, SearchOptions, Source, value::positive},
    preparation::prepare,
    scene::truth_file,
};

/// The references that captured folders are compared with.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Captured folders")]
pub struct RigOptions {
    /// True disparities of the centre in pixels at the nearest baseline, +inf where unknown [default: truth.pfm in RIG_DIR, if it
    /// is there]
    #[arg(long, value_name = "TRUTH.pfm", conflicts_with = "dataset")]
    truth: Option<PathBuf>,

    /// The scene is a flat wall, at this distance along the optical axis if it is given: measure how flat it seems, and how far
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true, conflicts_with = "dataset")]
    pub plane: Option<Option<f64>>,

    /// Part of the centre that shows the wall, in pixels: left and top edge, width and height [default: the middle half of both
    /// sides]
    #[arg(long, value_name = "X,Y,W,H", requires = "plane")]
    region: Option<ImageRegion>,

    /// Calibration of the lens, which distorts all images: a camera.toml, or the YAML of ROS, OpenCV or Kalibr [default: the lens
    /// of rig.toml]
    #[arg(long, value_name = "FILE", conflicts_with = "dataset")]
    lens: Option<PathBuf>,

    #[command(flatten)]
    bits: BitsOption,
}

/// The files of a captured folder.
pub struct RigFiles {
    /// The folder.
    pub directory: PathBuf,
    /// Its rig and images.
    pub source: Source,
    /// The file of its true disparities, if they are known.
    pub truth: Option<PathBuf>,
}

/// A capture, ready to be matched.
pub struct PreparedRig {
    /// The frames, undistorted and rectified.
    pub frames: Frames,
    /// The table that undistorted them, if the lens is known.
    pub undistortion: Option<Undistortion>,
    /// The geometry, if it is known.
    pub geometry: Option<Geometry>,
    /// The true disparities of the centre, if they are known.
    pub truth: Option<FloatImage>,
    /// Their preparation, with what it found.
    pub preparation: MatchSetup,
}

impl RigOptions {
    /// The files of a captured folder.
    pub fn files(&self, directory: &Path) -> Result<RigFiles> {
        if !directory.join(Rig::FILE_NAME).is_file() {
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
    pub fn region(&self, size: [usize; 2]) -> ImageRegion {
        match self.plane {
            Some(_) => self.region.unwrap_or(ImageRegion::middle(size)),
            None => ImageRegion::whole(size),
        }
    }
}

impl RigFiles {
    /// All files that are read.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.source.paths().chain(self.truth.as_deref())
    }

    /// Reads and prepares the capture.
    pub fn load(
        &mut self,
        geometry: &GeometryOptions,
        preparation: &PreparationOptions,
        search: &SearchOptions,
        memory: &MemoryOptions,
    ) -> Result<PreparedRig> {
        let (mut frames, _, undistortion) = self.source.load()?;
        let Source { rig, lens, images, .. } = &self.source;
        let mut geometry = geometry.geometry(rig.as_ref(), lens.as_ref(), &frames)?;
        let read = |path: &PathBuf| ground_truth::read_pfm(path, frames.size(), &images.center, limits());
        let truth = self.truth.as_ref().map(read).transpose()?;
        let (size, views) = (frames.size(), frames.views());
        let search = |range| search.search(size, views, None, range);
        let preparation = prepare(preparation, &self.source, undistortion.as_ref(), &mut frames, &mut geometry, memory, search)?;
        let truth = truth.map(|truth| preparation.truth(truth));
        Ok(PreparedRig { frames, undistortion, geometry, truth, preparation })
    }
}
