//! The frames that a command reads.

use std::path::PathBuf;

use clap::Args;
use multiscopic::{Error, Result, Rig, files::FrameFiles};

/// The frames: a captured folder, or an image for each.
#[derive(Clone, Debug, Args)]
pub struct SourceOptions {
    /// Captured folder with a rig.toml
    #[arg(value_name = "RIG_DIR", conflicts_with_all = ["center", "left", "right", "top", "bottom"])]
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
}

impl SourceOptions {
    /// The image files, and the rig of a captured folder. `None` if the command line names no images.
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
                let message = "the neighbours have no centre to match: give --center, or RIG_DIR, a folder with a rig.toml";
                Err(Error::Usage(message.into()))
            }
            (Some(_), true) => {
                let message = "there is no neighbour to match: give at least one of --left, --right, --top and --bottom";
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
