//! Preparing the JPEG images of cameras for the decoder.

use std::borrow::Cow;

/// An APP0 segment that marks an image as Motion JPEG.
const AVI1_SEGMENT: [u8; 9] = *b"\xFF\xE0\x00\x07AVI1\0";

/// Marks an image that has no Huffman tables as Motion JPEG.
///
/// Many cameras leave the tables out, because they are always those of ITU-T T.81, annex K.3. The decoder fills
/// these in, but only for marked images, and many cameras leave out the mark as well.
pub(super) fn mark_without_tables(image: &[u8]) -> Cow<'_, [u8]> {
    match image.split_at_checked(2) {
        Some((start, rest)) if has_no_tables(rest) => [start, &AVI1_SEGMENT, rest].concat().into(),
        _ => image.into(),
    }
}

/// Whether none of the segments (0xFF, marker, length, data) before the scan defines Huffman tables.
fn has_no_tables(mut segments: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xDA;
    const HUFFMAN_TABLES: u8 = 0xC4;
    while let Some(&[0xFF, marker, high, low]) = segments.first_chunk() {
        match marker {
            START_OF_SCAN => return true,
            HUFFMAN_TABLES => return false,
            _ => segments = segments.get(2 + usize::from(u16::from_be_bytes([high, low]))..).unwrap_or_default(),
        }
    }
    false
}
