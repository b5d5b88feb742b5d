//! Names of output files, whose ends must be those of their formats.

use std::path::{Path, PathBuf};

use multiscopic::{Error, Result};

/// The name of standard output.
const STANDARD_OUTPUT: &str = "-";

/// Parses the name of a PFM file, or `-` for standard output.
pub fn pfm_or_standard(text: &str) -> Result<PathBuf> {
    if text == STANDARD_OUTPUT { Ok(text.into()) } else { pfm(text) }
}

/// Whether a path is the name of standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new(STANDARD_OUTPUT)
}

/// Parses the name of a PFM file.
pub fn pfm(text: &str) -> Result<PathBuf> {
    named(text, &["pfm"])
}

/// Parses the name of a PNG file.
pub fn png(text: &str) -> Result<PathBuf> {
    named(text, &["png"])
}

/// Parses the name of a PLY file.
pub fn ply(text: &str) -> Result<PathBuf> {
    named(text, &["ply"])
}

/// Parses the name of a page.
pub fn html(text: &str) -> Result<PathBuf> {
    named(text, &["html", "htm"])
}

/// A name with one of the ends. Names without an end are those of devices and pipes.
fn named(text: &str, ends: &[&str]) -> Result<PathBuf> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(end) if !ends.iter().any(|expected| end.eq_ignore_ascii_case(expected)) => {
            Err(Error::Usage(format!("it ends in .{}, and this option writes .{} files", end.display(), ends[0])))
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
            assert_eq!(pfm(name).unwrap(), Path::new(name));
        }
        let error = pfm("d.png").unwrap_err().to_string();
        assert!(error.contains(".png") && error.contains(".pfm"), "{error}");
        assert!(png("d.jpg").is_err() && ply("d.pfm").is_err() && html("d").is_ok() && html("d.htm").is_ok());
        assert!(is_standard_output(&pfm_or_standard("-").unwrap()) && pfm_or_standard("d.txt").is_err());
    }
}
