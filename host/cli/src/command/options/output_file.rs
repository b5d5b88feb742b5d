//! Names of output files, whose ends must be those of their formats.

use std::path::{Path, PathBuf};

use multiscopic::{Error, FloatImage, Result};

/// The name of standard output.
const STANDARD_OUTPUT: &str = "-";

/// Parses the name of a file for real numbers, or `-` for standard output.
pub fn floats_or_standard(text: &str) -> Result<PathBuf> {
    if text == STANDARD_OUTPUT { Ok(text.into()) } else { floats(text) }
}

/// Returns true if a path is the name of standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new(STANDARD_OUTPUT)
}

/// Parses the name of a file for real numbers: PFM, NPY or NPZ.
pub fn floats(text: &str) -> Result<PathBuf> {
    named(text, &["pfm", "npy", "npz"])
}

/// Parses the name of a file for depths: those, or PNG.
pub fn depths(text: &str) -> Result<PathBuf> {
    named(text, &["pfm", "npy", "npz", "png"])
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
pub fn png(text: &str) -> Result<PathBuf> {
    named(text, &["png"])
}

/// Parses the name of a PLY file.
pub fn ply(text: &str) -> Result<PathBuf> {
    named(text, &["ply"])
}

/// Parses the name of a recording.
#[cfg(feature = "mcap")]
pub fn mcap(text: &str) -> Result<PathBuf> {
    named(text, &["mcap"])
}

/// Parses the name of a file for Rerun.
#[cfg(feature = "mcap")]
pub fn rrd(text: &str) -> Result<PathBuf> {
    named(text, &["rrd"])
}

/// Parses the name of a page.
pub fn html(text: &str) -> Result<PathBuf> {
    named(text, &["html", "htm"])
}

/// A name with one of the ends. Names without an end are those of devices and pipes.
fn named(text: &str, ends: &[&str]) -> Result<PathBuf> {
    let path = PathBuf::from(text);
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
        for name in ["d.pfm", "a/b.c/D.PFM", "/dev/null", "pipe"] {
            assert_eq!(floats(name).unwrap(), Path::new(name));
        }
        let error = floats("d.png").unwrap_err().to_string();
        assert!(error.contains("it ends in .png") && error.contains("writes .pfm or .npy or .npz files"), "{error}");
        assert!(png("d.jpg").is_err() && ply("d.pfm").is_err() && html("d").is_ok() && html("d.htm").is_ok());
        assert!(depths("d.png").is_ok() && depths("d.NPY").is_ok() && depths("d.npz").is_ok() && depths("d.exr").is_err());
        assert!(is_standard_output(&floats_or_standard("-").unwrap()) && floats_or_standard("d.txt").is_err());
    }
}
