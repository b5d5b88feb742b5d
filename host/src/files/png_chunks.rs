//! The chunks of PNG files.

use std::borrow::Cow;

const SIGNATURE_BYTES: usize = 8;

/// A chunk: length, name, data and checksum.
pub struct PngChunk<'a> {
    pub name: &'a [u8; 4],
    pub data: &'a [u8],
    /// All of its bytes.
    whole: &'a [u8],
}

impl PngChunk<'_> {
    /// Whether the pixels depend on it. The others hold colour profiles, texts and animations.
    fn is_critical(&self) -> bool {
        self.name[0].is_ascii_uppercase()
    }
}

/// The chunks of a PNG file, up to the first that is incomplete.
pub fn png_chunks(bytes: &[u8]) -> impl Iterator<Item = PngChunk<'_>> {
    let mut rest = bytes.get(SIGNATURE_BYTES..).unwrap_or_default();
    std::iter::from_fn(move || {
        let start = rest;
        let (length, data) = rest.split_first_chunk()?;
        let (name, data) = data.split_first_chunk()?;
        let length = u32::from_be_bytes(*length) as usize;
        rest = data.get(length.checked_add(4)?..)?;
        Some(PngChunk { name, data: &data[..length], whole: &start[..start.len() - rest.len()] })
    })
}

/// A PNG file without the chunks that its pixels do not depend on. The decoder would inflate a colour profile, to a thousand
/// times its size.
pub fn without_metadata(bytes: &[u8]) -> Cow<'_, [u8]> {
    if png_chunks(bytes).all(|chunk| chunk.is_critical()) {
        return bytes.into();
    }
    let signature = &bytes[..SIGNATURE_BYTES.min(bytes.len())];
    let critical = png_chunks(bytes).filter(PngChunk::is_critical).map(|chunk| chunk.whole);
    [signature].into_iter().chain(critical).collect::<Vec<_>>().concat().into()
}
