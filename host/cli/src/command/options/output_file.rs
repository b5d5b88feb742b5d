//! The files that disparity maps are written to, and names of output files, whose ends must be those of their formats.

use std::path::{Path, PathBuf};

use clap::{
    Args,
    builder::{PathBufValueParser, TypedValueParser},
};
use multiscopic::{
    DisparityMap, Error, FloatImage, Picture, Result,
    images::{ColorScale, Colormap},
};

use super::named;
use crate::{command::terminal, report::color_bar};

/// The files that a disparity map is written to.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct MapFiles {
    /// Disparities in pixels, +inf where invalid, as PFM or for numpy (OUT.npy, OUT.npz); - is standard output, as PFM
    #[arg(short, long, value_name = "OUT.pfm", value_parser = floats())]
    output: Option<PathBuf>,

    /// Disparities in colour: near is red, far is blue, invalid is black
    #[arg(long, value_name = "OUT.png", value_parser = png())]
    png: Option<PathBuf>,

    /// Draw a colour bar beside coloured pictures, with a scale in their unit
    #[arg(long)]
    png_colorbar: bool,

    /// Colours of pictures
    #[arg(long, value_name = "MAP", value_parser = named::<Colormap>(), default_value = "turbo")]
    colormap: Colormap,

    /// Disparities times 64 plus 32768 as a 16-bit image, 0 where invalid
    #[arg(long, value_name = "OUT.png", value_parser = png())]
    raw16: Option<PathBuf>,
}

impl MapFiles {
    /// The paths of all files.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        [self.output_file(), self.png.as_deref(), self.raw16.as_deref()].into_iter().flatten()
    }

    /// The paths of all files, and of standard output.
    pub fn paths_mut(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        [&mut self.output, &mut self.png, &mut self.raw16].into_iter().flatten()
    }

    /// Refuses two things on standard output: the disparities, or what one of `others` prints, an option that may be given.
    /// Returns whether anything is printed.
    pub fn check_printed(&self, others: &[(&str, bool)]) -> Result<bool> {
        let printed = [("-o -", self.is_printed())].into_iter().chain(others.iter().copied());
        let printed: Vec<&str> = printed.filter_map(|(option, is_given)| is_given.then_some(option)).collect();
        match printed[..] {
            [first, second, ..] => Err(Error::Usage(format!("{first} and {second} both take standard output: give one of them"))),
            _ => Ok(!printed.is_empty()),
        }
    }

    /// Returns true if standard output gets the disparities.
    fn is_printed(&self) -> bool {
        self.output.as_deref().is_some_and(is_standard_output)
    }

    /// The file of disparities in pixels.
    fn output_file(&self) -> Option<&Path> {
        self.output.as_deref().filter(|path| !is_standard_output(path))
    }

    /// Writes `disparities` to all files.
    pub fn write(&self, disparities: &DisparityMap) -> Result<()> {
        if let Some(path) = self.output_file() {
            write_floats(&disparities.to_float(), path, "disparity")?;
        }
        if let Some(path) = &self.png {
            self.draw(&disparities.to_float(), &self.scale(disparities)).write_png(path)?;
        }
        if let Some(path) = &self.raw16 {
            multiscopic::files::write_raw16(disparities, path)?;
        }
        Ok(())
    }

    /// Writes `disparities` to standard output, if it gets them.
    pub fn print(&self, disparities: &DisparityMap) -> Result<()> {
        if self.is_printed() { terminal::print_bytes(&multiscopic::files::pfm_bytes(&disparities.to_float())) } else { Ok(()) }
    }

    /// The file of disparities in pixels, if it is in the same folder as another file.
    pub fn beside(&self, other: &Path) -> Option<String> {
        let name = self.output_file().filter(|output| output.parent() == other.parent())?.file_name()?;
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

/// The name of standard output.
const STANDARD_OUTPUT: &str = "-";

/// Returns true if a path is the name of standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new(STANDARD_OUTPUT)
}

/// Parses the name of a file for real numbers: PFM, NPY or NPZ.
pub fn floats() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["pfm", "npy", "npz"])
}

/// Parses the name of a file for depths: those, or PNG.
pub fn depths() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["pfm", "npy", "npz", "png"])
}

/// Returns true if a path ends in `.` and `end`.
pub fn ends_in(path: &Path, end: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(end))
}

/// Writes real numbers as the name of the file says, in an archive by the name of `what` they are.
pub fn write_floats(image: &FloatImage, path: &Path, what: &str) -> Result<()> {
    if ends_in(path, "npy") {
        multiscopic::files::write_npy(image, path)
    } else if ends_in(path, "npz") {
        multiscopic::files::write_npz(image, path, what)
    } else {
        multiscopic::files::write_pfm(image, path)
    }
}

/// Parses the name of a PNG file.
pub fn png() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["png"])
}

/// Parses the name of a PLY file.
pub fn ply() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["ply"])
}

/// Parses the name of a recording.
#[cfg(feature = "mcap")]
pub fn mcap() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["mcap"])
}

/// Parses the name of a file for Rerun.
#[cfg(feature = "mcap")]
pub fn rrd() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["rrd"])
}

/// Parses the name of a page.
pub fn html() -> impl TypedValueParser<Value = PathBuf> {
    ending(&["html", "htm"])
}

/// Parses a name with one of the ends, in any characters, as those of inputs. Names without an end are those of devices and
/// pipes.
fn ending(ends: &'static [&str]) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| with_end(path, ends))
}

fn with_end(path: PathBuf, ends: &[&str]) -> Result<PathBuf> {
    match path.extension() {
        Some(end) if !ends.iter().any(|expected| ends_in(&path, expected)) => {
            Err(Error::Usage(format!("it ends in .{}, and this option writes .{} files", end.display(), ends.join(" or ."))))
        }
        _ => Ok(path),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_as_their_formats() {
        let parse = |parser: clap::builder::ValueParser, name: &str| {
            let command = clap::Command::new("multiscopic").arg(clap::Arg::new("name").value_parser(parser));
            let parsed = command.try_get_matches_from(["multiscopic", "--", name]).map_err(|error| error.to_string());
            parsed.map(|found| found.get_one::<PathBuf>("name").expect("a name").clone())
        };
        let [floats, depths, png, ply, html] = [floats().into(), depths().into(), png().into(), ply().into(), html().into()]
            .map(|parser: clap::builder::ValueParser| move |name: &str| parse(parser.clone(), name));
        for name in ["d.pfm", "a/b.c/D.PFM", "/dev/null", "pipe", "-", "d.Npy"] {
            assert_eq!(floats(name).unwrap(), Path::new(name));
        }
        for name in ["d.png", "d.pfm.bak", "d.txt"] {
            let error = floats(name).unwrap_err();
            assert!(error.contains("it ends in .") && error.contains("writes .pfm or .npy or .npz files"), "{error}");
        }
        assert!(png("d.jpg").is_err() && ply("d.pfm").is_err() && html("d").is_ok() && html("d.htm").is_ok());
        assert!(depths("d.png").is_ok() && depths("d.NPY").is_ok() && depths("d.npz").is_ok() && depths("d.exr").is_err());
        assert!(is_standard_output(&floats("-").unwrap()));
    }
}
