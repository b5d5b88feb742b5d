//! Detecting truncated PNG and JPEG files. The decoders fill in missing pixels without an error.

use image::ImageFormat;

use super::{
    jpeg_markers::{END_OF_IMAGE, is_bare, next_marker, segment},
    png_chunks::png_chunks,
};

/// Whether the end marker is missing, or the file is too short for that many pixels.
pub fn is_truncated(format: ImageFormat, bytes: &[u8], pixels: u64) -> bool {
    match format {
        ImageFormat::Png => !png_has_end(bytes),
        // Each block of 8x8 pixels takes at least one bit.
        ImageFormat::Jpeg => !jpeg_has_end(bytes) || pixels > 8 * 64 * bytes.len() as u64,
        _ => false,
    }
}

fn png_has_end(bytes: &[u8]) -> bool {
    png_chunks(bytes).any(|chunk| chunk.name == b"IEND")
}

/// Follows the segments, and the coded data between them, to the marker at the end.
fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    while let Some((marker, after)) = next_marker(rest) {
        rest = match (marker, segment(after)) {
            (END_OF_IMAGE, _) => return true,
            (marker, _) if is_bare(marker) => after,
            (_, Some((_, after))) => after,
            (_, None) => return false,
        };
    }
    false
}
