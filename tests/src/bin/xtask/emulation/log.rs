//! Decodes the firmware's log.

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, Table};
use std::{fs, path::Path};

/// Decodes `bytes`, the log of the firmware in `image`, into lines.
pub fn decode(image: &Path, bytes: &[u8]) -> Result<Vec<String>> {
    let elf = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let Some(table) = Table::parse(&elf)? else { return Ok(Vec::new()) };
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("print", |level| level.as_str());
                let time = frame.display_timestamp().map(|time| format!("{time} s ")).unwrap_or_default();
                lines.push(format!("{time}{level}: {}", frame.display_message()));
            }
            Err(DecodeError::UnexpectedEof) => return Ok(lines),
            Err(DecodeError::Malformed) => bail!("the log of {} is damaged after {} lines", image.display(), lines.len()),
        }
    }
}
