//! The markers of JPEG files, and the segments that follow them.

pub const START_OF_SCAN: u8 = 0xDA;
pub const END_OF_IMAGE: u8 = 0xD9;

/// Returns true if no segment follows a marker: a restart, or the start of the image.
pub fn is_bare(marker: u8) -> bool {
    matches!(marker, 0x01 | 0xD0..=0xD8)
}

/// The next marker, and what follows it.
pub fn next_marker(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let start = bytes.windows(2).position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF))?;
    Some((bytes[start + 1], &bytes[start + 2..]))
}

/// The data of a segment without its length, and what follows it.
pub fn segment(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u16::from_be_bytes(*bytes.first_chunk()?);
    let (segment, rest) = bytes.split_at_checked(length.into())?;
    Some((segment.get(2..).unwrap_or_default(), rest))
}
