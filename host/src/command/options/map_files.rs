//! The files that disparity maps are written to.

use std::path::{Path, PathBuf};

use clap::Args;
use multiscopic::{
    DisparityMap, FloatImage, Picture, Result,
    images::{ColorScale, Colormap},
    report::color_bar,
};

use super::named::named;

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

    /// Draw a colour bar beside coloured pictures, with a scale in their unit
    #[arg(long)]
    png_colorbar: bool,

    /// Colours of pictures
    #[arg(long, value_name = "MAP", value_parser = named::<Colormap>(), default_value = "turbo")]
    colormap: Colormap,

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
            self.draw(&disparities.to_float(), &self.scale(disparities)).write_png(path)?;
        }
        if let Some(path) = &self.raw16 {
            disparities.write_raw16(path)?;
        }
        Ok(())
    }

    /// The file of disparities in pixels, if it is in the same folder as another file.
    pub fn beside(&self, other: &Path) -> Option<String> {
        let name = self.output.file_name().filter(|_| self.output.parent() == other.parent())?;
        Some(name.to_string_lossy().into_owned())
    }

    /// The colour map that was asked for.
    pub fn colormap(&self) -> Colormap {
        self.colormap
    }

    /// The colours of disparities, from the smallest to the largest.
    pub fn scale(&self, disparities: &DisparityMap) -> ColorScale {
        ColorScale::of_disparities(self.colormap, disparities.range())
    }

    /// A coloured picture, with a colour bar if it was asked for.
    pub fn draw(&self, image: &FloatImage, scale: &ColorScale) -> Picture {
        let drawn = scale.draw(image);
        Picture::Rgb(if self.png_colorbar { color_bar::beside(&drawn, scale) } else { drawn })
    }
}
