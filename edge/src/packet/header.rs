//! The header of a packet.

use serde::{Deserialize, Serialize};

/// The first bytes of every packet.
pub const MAGIC: [u8; 4] = *b"mscp";
/// The version of the packet format.
pub const VERSION: u8 = 1;

/// The most bytes of a header: magic and version, then as `postcard` encodes numbers, five for 32 bits, three
/// for 16 bits, and one for the variant of the content.
pub(super) const MAX_HEADER_BYTES: usize = MAGIC.len() + 1 + 5 + 3 + 3 + 1 + 3 * 3;

/// The header of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    pub(super) magic: [u8; 4],
    pub(super) version: u8,
    /// Counts the packets of a frame, from 0.
    pub sequence: u32,
    /// Pixels in a line of the frame.
    pub width: u16,
    /// Lines of the frame.
    pub height: u16,
    /// The content.
    pub content: Content,
}

/// The content of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Content {
    /// A line of disparities, or the part of it in one column tile.
    Line {
        /// The line's number in the frame.
        line: u16,
        /// The first column, counted in the frame.
        left: u16,
        /// The number of columns.
        columns: u16,
    },
    /// The end of the frame.
    End {
        /// The greatest depth of the sender's stack in bytes, if the sender measures it. A simulation on a
        /// host does not.
        stack: Option<u32>,
    },
    /// A line of disparities and their confidences. They come from the whole frame, so there are no tiles as yet, but a receiver
    /// takes parts of lines as those of [`Line`](Content::Line).
    // Last, so that the others keep their numbers: packets without confidences are as they were before there were any.
    LineWithConfidences {
        /// The line's number in the frame.
        line: u16,
        /// The first column, counted in the frame.
        left: u16,
        /// The number of columns.
        columns: u16,
    },
}
