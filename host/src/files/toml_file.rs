//! TOML files as values.

use std::path::Path;

use serde::{Serialize, de::DeserializeOwned};

use super::{input, output};
use crate::error::{Error, Result};

/// The characters of a line that a message quotes.
const MOST_QUOTED: usize = 80;

/// The value in the TOML file `path`, which should be `expected`, such as "a rig.toml".
pub(crate) fn read<T: DeserializeOwned>(path: &Path, expected: &str) -> Result<T> {
    let text = input::read_text(path)?;
    toml::from_str(&text).map_err(|error| Error::format(path, with_line(&error, &text), expected))
}

/// Writes `value` to `path`. Any previous version of the file is unchanged if this fails.
pub(crate) fn write(path: &Path, value: &impl Serialize) -> Result<()> {
    // This fails only for a path that is not Unicode.
    let text = toml::to_string(value).map_err(|error| Error::format(path, error.to_string(), "file names in UTF-8"))?;
    output::write(path, |writer| writer.write_all(text.as_bytes()))
}

/// The error's message with the line it refers to, as the message often does not name the key.
fn with_line(error: &toml::de::Error, text: &str) -> String {
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else {
        return error.message().into();
    };
    let number = before.matches('\n').count();
    let mut line: String = text.lines().nth(number).unwrap_or_default().trim().into();
    if let Some((end, _)) = line.char_indices().nth(MOST_QUOTED) {
        line.truncate(end);
        line.push_str("...");
    }
    format!("line {} ({line}): {}", number + 1, error.message())
}
