//! Where a command's frames come from.

use std::path::PathBuf;

use clap::Args;
use multiscopic::{Error, Result, Rig, files::FrameFiles};

/// The files of a capture: a folder with all of them, or each by itself.
#[derive(Clone, Debug, Args)]
pub struct SourceOptions {
    /// Folder of a capture, with its rig.toml
    #[arg(value_name = "RIG_DIR", conflicts_with_all = ["center", "left", "right", "top", "bottom"])]
    rig: Option<PathBuf>,

    /// Image in the centre: the reference
    #[arg(long, value_name = "IMAGE")]
    center: Option<PathBuf>,

    /// Image with the camera moved to the left
    #[arg(long, value_name = "IMAGE")]
    left: Option<PathBuf>,

    /// Image with the camera moved to the right
    #[arg(long, value_name = "IMAGE")]
    right: Option<PathBuf>,

    /// Image with the camera moved up
    #[arg(long, value_name = "IMAGE")]
    top: Option<PathBuf>,

    /// Image with the camera moved down
    #[arg(long, value_name = "IMAGE")]
    bottom: Option<PathBuf>,
}

impl SourceOptions {
    /// The files of the frames, and what is known of how they were captured; `None` if none is given.
    pub fn capture(&self) -> Result<Option<(FrameFiles, Option<Rig>)>> {
        if let Some(directory) = &self.rig {
            let rig = Rig::load(directory)?;
            return Ok(Some((rig.images.within(directory), Some(rig))));
        }
        let SourceOptions { center, left, right, top, bottom, rig: _ } = self.clone();
        let images = FrameFiles { center: center.clone().unwrap_or_default(), left, right, top, bottom };
        match (center, images.views().is_empty()) {
            (None, true) => Ok(None),
            (None, false) => {
                let message =
                    "the neighbours have no image to be matched with, give --center, or RIG_DIR, a folder with a rig.toml";
                Err(Error::Usage(message.into()))
            }
            (Some(_), true) => {
                let message = "there is no neighbour to match with, give at least one of --left, --right, --top and --bottom";
                Err(Error::Usage(message.into()))
            }
            (Some(_), false) => Ok(Some((images, None))),
        }
    }

    /// What is read beside the frames.
    pub fn rig_file(&self) -> Option<PathBuf> {
        self.rig.as_ref().map(|directory| directory.join(Rig::FILE_NAME))
    }
}
