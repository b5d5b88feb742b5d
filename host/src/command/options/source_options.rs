//! The frames that a command reads.

use std::{path::PathBuf, str::FromStr};

use clap::Args;
use multiscopic::{Error, Rig, files::FrameFiles};
use multiscopic_core::{Frame, ParseViewError, View, Views};

/// The frames: a captured folder, or an image for each.
#[derive(Clone, Debug, Args)]
pub struct SourceOptions {
    /// Captured folder with a rig.toml
    #[arg(value_name = "RIG_DIR", conflicts_with_all = ["center", "left", "right", "top", "bottom", "view"])]
    rig: Option<PathBuf>,

    /// Centre image, the reference
    #[arg(long, value_name = "IMAGE")]
    center: Option<PathBuf>,

    /// Image taken with the camera moved to the left
    #[arg(long, value_name = "IMAGE")]
    left: Option<PathBuf>,

    /// Image taken with the camera moved to the right
    #[arg(long, value_name = "IMAGE")]
    right: Option<PathBuf>,

    /// Image taken with the camera moved up
    #[arg(long, value_name = "IMAGE")]
    top: Option<PathBuf>,

    /// Image taken with the camera moved down
    #[arg(long, value_name = "IMAGE")]
    bottom: Option<PathBuf>,

    /// Image taken with the camera moved by I baselines to the right and J down, such as 1,-1=IMAGE; repeat it for more
    #[arg(long, value_name = "I,J=IMAGE", value_parser = ViewImage::from_str, allow_hyphen_values = true)]
    view: Vec<ViewImage>,
}

/// A view and its image, as `--view` takes them.
#[derive(Clone, Debug)]
struct ViewImage {
    view: View,
    path: PathBuf,
}

impl FromStr for ViewImage {
    type Err = String;

    fn from_str(text: &str) -> Result<ViewImage, String> {
        let (view, path) = text.split_once('=').ok_or("it has no = between the view and its image, as in 1,-1=IMAGE")?;
        Ok(ViewImage { view: view.parse().map_err(|error: ParseViewError| error.to_string())?, path: path.into() })
    }
}

impl SourceOptions {
    /// The image files, and the rig of a captured folder. `None` if the command line names no images.
    pub fn frame_files(&self) -> multiscopic::Result<Option<(FrameFiles, Option<Rig>)>> {
        if let Some(directory) = &self.rig {
            let rig = Rig::load(directory)?;
            return Ok(Some((rig.images.within(directory), Some(rig))));
        }
        let SourceOptions { center, left, right, top, bottom, view, rig: _ } = self.clone();
        let images = FrameFiles { center: center.clone().unwrap_or_default(), left, right, top, bottom, ..FrameFiles::default() };
        let images = view.into_iter().try_fold(images, |images, ViewImage { view, path }| {
            if images.get(Frame::View(view)).is_some() {
                return Err(Error::Usage(format!("there are two images of the {view} view: give one")));
            }
            if images.views().len() == Views::MAX {
                return Err(Error::Usage(format!("there are more than {} views", Views::MAX)));
            }
            Ok(images.with(view, path))
        })?;
        match (center, images.views().is_empty()) {
            (None, true) => Ok(None),
            (None, false) => {
                let message = "the neighbours have no centre to match: give --center, or RIG_DIR, a folder with a rig.toml";
                Err(Error::Usage(message.into()))
            }
            (Some(_), true) => {
                let message = "there is no neighbour to match: give at least one of --left, --right, --top, --bottom and --view";
                Err(Error::Usage(message.into()))
            }
            (Some(_), false) => Ok(Some((images, None))),
        }
    }

    /// The rig.toml that is read as well as the images.
    pub fn rig_file(&self) -> Option<PathBuf> {
        self.rig.as_ref().map(|directory| directory.join(Rig::FILE_NAME))
    }
}
