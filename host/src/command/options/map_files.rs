//! The files that disparity maps are written to.

use std::path::{Path, PathBuf};

use clap::Args;
use multiscopic::{DisparityMap, Result};

/// The files that a disparity map is written to.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct MapFiles {
    /// Disparities in pixels, +inf where invalid
    #[arg(short, long, value_name = "OUT.pfm")]
    output: PathBuf,

    /// Disparities in colour: near is red, far is blue, invalid is black
    #[arg(long, value_name = "OUT.png")]
    png: Option<PathBuf>,

    /// Disparities times 64 plus 32768 as a 16-bit image, 0 where invalid
    #[arg(long, value_name = "OUT.png")]
    raw16: Option<PathBuf>,
}

impl MapFiles {
    /// The paths of all files.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.output), self.png.as_ref(), self.raw16.as_ref()].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Writes `disparities` to all files.
    pub fn write(&self, disparities: &DisparityMap) -> Result<()> {
        disparities.write_pfm(&self.output)?;
        if let Some(path) = &self.png {
            disparities.write_color_png(path, None)?;
        }
        if let Some(path) = &self.raw16 {
            disparities.write_raw16(path)?;
        }
        Ok(())
    }
}
