//! The results of the decoders of all formats.

use std::{fmt::Display, path::Path};

use image::DynamicImage;

use crate::{error::Error, images::FloatImage};

/// The contents of a file.
pub(crate) enum Decoded {
    /// Samples of 8 or 16 bits, turned upright.
    Samples(DynamicImage),
    /// Numbers of one channel.
    Numbers(Numbers),
}

/// Real or signed numbers.
pub(crate) struct Numbers {
    /// The numbers.
    pub(crate) map: FloatImage,
    /// Set if the file's numbers are whole by their type.
    pub(crate) is_whole: bool,
}

/// The error of a damaged file of the format `name`.
pub(super) fn damaged(path: &Path, name: &str, cause: &dyn Display) -> Error {
    // Some decoders' messages have several lines.
    let cause = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    let found = format!("a damaged or truncated {name} image ({cause})");
    Error::format(path, found, "a complete one: copy or capture it again")
}
