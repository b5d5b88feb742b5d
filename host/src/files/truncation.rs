//! Detecting truncated PNG and JPEG files. The decoders fill in missing pixels without an error.

use image::ImageFormat;

use super::png_chunks::png_chunks;

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

/// Follows the segments (0xFF, marker, length, data) and the coded data between them to the marker EOI.
fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    while let Some(&[first, marker]) = rest.first_chunk() {
        let skip = match (first, marker) {
            (0xFF, 0xD9) => return true,
            // A fill byte before a marker.
            (0xFF, 0xFF) => 1,
            // An escaped 0xFF, a restart or the start of the image: markers without data.
            (0xFF, 0x00 | 0x01 | 0xD0..=0xD8) => 2,
            (0xFF, _) => match rest.get(2..4) {
                Some(length) => 2 + usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
            _ => 1,
        };
        rest = rest.get(skip..).unwrap_or_default();
    }
    false
}
