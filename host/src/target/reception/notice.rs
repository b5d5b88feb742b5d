//! Reports of a reception, flaws of packets, and the frame that is received.

use std::fmt;

use multiscopic_edge::packet::PacketError;

use crate::images::{DisparityMap, Raster};

/// An event during reception.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// A line was received.
    Line {
        /// Number of the frame's pixels received so far.
        pixels: usize,
        /// Number of pixels in the frame.
        of: usize,
    },
    /// A packet did not arrive as it was sent.
    Flaw(Flaw),
}

/// Identifies a packet of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketId {
    /// Its line. A frame sent in column tiles has each line once per tile.
    pub line: u32,
    /// Its sequence number in the frame, from 0.
    pub sequence: u32,
}

impl PacketId {
    /// The packet with this sequence number, in a frame of `height` lines: each tile has one packet per line.
    pub(super) fn of_sequence(sequence: u32, height: u32) -> PacketId {
        PacketId { line: sequence % height, sequence }
    }
}

impl fmt::Display for PacketId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {} (packet {})", self.line, self.sequence)
    }
}

/// A packet that did not arrive as it was sent, or did not belong.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Flaw {
    /// A packet arrived damaged.
    Damaged {
        /// The packet. Only known if as many packets are missing as arrived damaged.
        packet: Option<PacketId>,
        /// The packet before it.
        after: Option<PacketId>,
        /// The error by which the damage was noticed.
        error: PacketError,
    },
    /// Packets of consecutive lines are missing.
    Lost {
        /// The first of them.
        first: PacketId,
        /// The last of them.
        last: PacketId,
    },
    /// The packet that ends the frame is missing.
    NoEnd {
        /// The last packet that arrived.
        after: PacketId,
    },
    /// An undamaged packet that has no disparities, or contradicts itself.
    Foreign {
        /// The packet before it.
        after: Option<PacketId>,
        /// The error in it.
        error: PacketError,
    },
    /// A packet of a frame of another size.
    OtherFrame {
        /// Width and height of that frame.
        found: [usize; 2],
        /// Width and height of the frame being received.
        expected: [usize; 2],
    },
    /// A packet with pixels that had already been received.
    Repeated(PacketId),
}

impl Flaw {
    /// Returns true if pixels of the frame may be missing or wrong. Packets from elsewhere do no harm.
    pub fn is_harmful(&self) -> bool {
        !matches!(self, Flaw::Foreign { .. } | Flaw::OtherFrame { .. })
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let position =
            |after: &Option<PacketId>| after.map_or("before the first line".into(), |packet| format!("after {packet}"));
        match self {
            Flaw::Damaged { packet: Some(packet), error, .. } => write!(f, "{packet} is damaged: {error}"),
            Flaw::Damaged { after, error, .. } => write!(f, "{}: {error}", position(after)),
            Flaw::Lost { first, last } if first == last => write!(f, "{first} is lost"),
            Flaw::Lost { first, last } => {
                write!(f, "lines {} to {} (packets {} to {}) are lost", first.line, last.line, first.sequence, last.sequence)
            }
            Flaw::NoEnd { after } => write!(f, "the end of the frame is lost: nothing came after {after}"),
            Flaw::Foreign { after, error } => write!(f, "foreign data {}: {error}", position(after)),
            Flaw::OtherFrame { found: [w, h], expected: [width, height] } => {
                write!(f, "ignored a packet of another frame: {w}x{h} pixels instead of {width}x{height}")
            }
            Flaw::Repeated(packet) => write!(f, "{packet} repeats pixels that had already arrived"),
        }
    }
}

/// A frame of disparities as it was received.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedFrame {
    /// The disparities. Pixels that were not received are invalid.
    pub disparities: DisparityMap,
    /// The confidences of the disparities, if packets carried some: the probability that a disparity is at most one pixel off,
    /// times 255. Pixels that were received without are 0, as are those that were not received.
    pub confidences: Option<Raster<u8>>,
    /// Number of pixels received.
    pub pixels: usize,
    /// Greatest depth of the sender's stack in bytes, if the sender measures it.
    pub stack: Option<usize>,
}

impl ReceivedFrame {
    /// Returns true if every pixel was received.
    pub fn is_complete(&self) -> bool {
        self.pixels == self.disparities.pixels().len()
    }
}
