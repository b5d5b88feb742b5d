//! The receiving side: decodes packets, and notices those that are lost.

use core::{error, fmt, mem};
use multiscopic_core::Disparity;

use super::{CHECKSUM_BYTES, Content, Header, MAGIC, VERSION, checksum};

/// A packet that arrived undamaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// The header.
    pub header: Header,
    samples: &'a [u8],
    confidences: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Decodes a packet in place. `bytes` are those before the zero that ends it.
    ///
    /// # Errors
    /// The bytes are damaged, or are not a packet of this version.
    pub fn decode(bytes: &'a mut [u8]) -> Result<Packet<'a>, PacketError> {
        let len = cobs::decode_in_place(bytes).map_err(|_| PacketError::Framing)?;
        let bytes = bytes.get(..len).unwrap_or_default();
        let (bytes, &sent) = bytes.split_last_chunk::<CHECKSUM_BYTES>().ok_or(PacketError::Framing)?;
        let (expected, found) = (u32::from_le_bytes(sent), checksum(bytes));
        if found != expected {
            return Err(PacketError::Damaged { expected, found });
        }
        let [magic @ .., version] = *bytes.first_chunk::<{ MAGIC.len() + 1 }>().ok_or(PacketError::Foreign)?;
        if magic != MAGIC {
            return Err(PacketError::Foreign);
        }
        if version != VERSION {
            return Err(PacketError::Version { found: version });
        }
        let (header, body) = postcard::take_from_bytes::<Header>(bytes).map_err(|_| PacketError::Header)?;
        let columns = match header.content {
            Content::Line { line, left, columns } | Content::LineWithConfidences { line, left, columns } => {
                if line >= header.height || u32::from(left) + u32::from(columns) > u32::from(header.width) {
                    return Err(PacketError::Outside { header });
                }
                columns.into()
            }
            Content::End { .. } => 0,
        };
        let confidences = if let Content::LineWithConfidences { .. } = header.content { columns } else { 0 };
        let wrong_length = PacketError::Length { columns, bytes: body.len() };
        match body.split_at_checked(2 * columns) {
            Some((samples, rest)) if rest.len() == confidences => Ok(Packet { header, samples, confidences: rest }),
            _ => Err(wrong_length),
        }
    }

    /// The disparities of the line, from left to right.
    pub fn disparities(&self) -> impl ExactSizeIterator<Item = Option<Disparity>> + use<'a> {
        self.samples.as_chunks().0.iter().map(|&bytes| Disparity::from_raw16(u16::from_le_bytes(bytes)))
    }

    /// The confidences of these disparities: the probability that one is at most one pixel off, times 255, and 0 where it is
    /// invalid. Empty if the packet carries none.
    pub fn confidences(&self) -> &'a [u8] {
        self.confidences
    }
}

/// An error of bytes that are not a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PacketError {
    /// The bytes are not valid COBS, or too few: some are missing.
    Framing,
    /// The checksum is wrong.
    Damaged {
        /// The checksum in the packet.
        expected: u32,
        /// The checksum of the bytes that arrived.
        found: u32,
    },
    /// The bytes are undamaged, but not from this sender.
    Foreign,
    /// The packet has another version of the format.
    Version {
        /// That version.
        found: u8,
    },
    /// The header is not one of this version.
    Header,
    /// The line lies outside its frame.
    Outside {
        /// The header that says so.
        header: Header,
    },
    /// The number of disparities, or of confidences, differs from the header's.
    Length {
        /// The number of columns in the header.
        columns: usize,
        /// The number of bytes after the header.
        bytes: usize,
    },
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PacketError::Framing => write!(f, "a damaged packet: some of its bytes are missing"),
            PacketError::Damaged { expected, found } => {
                write!(f, "a damaged packet: its checksum is {found:08x}, it was sent with {expected:08x}")
            }
            PacketError::Foreign => write!(f, "not a packet of disparities"),
            PacketError::Version { found } => write!(f, "a packet of version {found}, expected version {VERSION}"),
            PacketError::Header => write!(f, "a packet with an invalid header"),
            PacketError::Outside { header } => {
                write!(f, "{:?} lies outside a frame of {}x{} pixels", header.content, header.width, header.height)
            }
            PacketError::Length { columns, bytes } => {
                write!(f, "a packet of {columns} columns with {bytes} bytes of disparities and confidences")
            }
        }
    }
}

impl error::Error for PacketError {}

/// Notices packets that are missing between those that arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Receiver {
    next: u32,
}

impl Receiver {
    /// Accepts a packet. The next one expected is its successor, even if packets before it are missing.
    ///
    /// # Errors
    /// [`Lost`] if the packet is not the one expected.
    pub fn accept(&mut self, header: &Header) -> Result<(), Lost> {
        let next = match header.content {
            Content::Line { .. } | Content::LineWithConfidences { .. } => header.sequence.wrapping_add(1),
            Content::End { .. } => 0,
        };
        let expected = mem::replace(&mut self.next, next);
        if header.sequence == expected { Ok(()) } else { Err(Lost { expected, found: header.sequence }) }
    }
}

/// Packets were lost between two that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lost {
    /// The sequence number that was expected.
    pub expected: u32,
    /// The sequence number that arrived.
    pub found: u32,
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "packets were lost: expected number {}, found number {}", self.expected, self.found)
    }
}

impl error::Error for Lost {}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::packet::{Sender, buffer_bytes, buffer_bytes_with_confidences};
    use multiscopic_core::{BlockMatchingParams, Region, SearchConfig, valid};
    use std::{vec, vec::Vec};

    const SEARCH: SearchConfig = SearchConfig { num_disparities: 4, ..SearchConfig::of_size(40, 20) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        // Many of the bytes are zero.
        let sample = |u: u32| (2731 * u % 65536) as u16 & if u.is_multiple_of(3) { 0xff00 } else { 0xffff };
        let line: Vec<_> = (0..30).map(|u| Disparity::from_raw16(sample(u))).collect();
        let confidences: Vec<_> = (0..30).map(|u| sample(u) as u8).collect();
        let mut buffer = vec![0; buffer_bytes_with_confidences(30)];
        let region = Region::new(PARAMS.search(), 3..33, 0..20).unwrap();
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        assert_damage_is_noticed(sender.line(&region, 7, &line).unwrap());
        assert_damage_is_noticed(sender.line_with_confidences(&region, 7, &line, &confidences).unwrap());
    }

    #[track_caller]
    fn assert_damage_is_noticed(packet: &[u8]) {
        let (&zero, bytes) = packet.split_last().unwrap();
        assert_eq!(zero, 0);
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.to_vec();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let found = Packet::decode(&mut damaged).unwrap_err();
            assert!(matches!(found, PacketError::Framing | PacketError::Damaged { .. }), "bit {bit}: {found}");
        }
        for len in 0..bytes.len() {
            let found = Packet::decode(&mut bytes[..len].to_vec()).unwrap_err();
            assert!(matches!(found, PacketError::Framing | PacketError::Damaged { .. }), "{len} bytes: {found}");
        }
    }

    #[test]
    fn invalid_packets_have_an_error_each() {
        let encoded = |bytes: &[u8]| {
            let mut encoded = vec![0; 100];
            let bytes = [bytes, &checksum(bytes).to_le_bytes()].concat();
            let len = cobs::encode(&bytes, &mut encoded);
            encoded.truncate(len);
            encoded
        };
        assert_eq!(Packet::decode(&mut encoded(b"abcd\x01ef")), Err(PacketError::Foreign));
        assert_eq!(Packet::decode(&mut encoded(b"mscp\x07ef")), Err(PacketError::Version { found: 7 }));
        assert_eq!(Packet::decode(&mut encoded(b"mscp\x01e")), Err(PacketError::Header));
        let header = |content| Header { magic: MAGIC, version: VERSION, sequence: 0, width: 4, height: 2, content };
        let packet = |header: &Header| encoded(postcard::to_slice(header, &mut [0; 64]).unwrap());
        let outside = header(Content::Line { line: 1, left: 2, columns: 3 });
        assert_eq!(Packet::decode(&mut packet(&outside)), Err(PacketError::Outside { header: outside }));
        let short = header(Content::Line { line: 1, left: 2, columns: 2 });
        assert_eq!(Packet::decode(&mut packet(&short)), Err(PacketError::Length { columns: 2, bytes: 0 }));
        // Confidences are missing, or come where none were announced.
        let body = |content, samples: &[u8]| [postcard::to_slice(&header(content), &mut [0; 64]).unwrap(), samples].concat();
        let (sure, plain) =
            (Content::LineWithConfidences { line: 1, left: 2, columns: 2 }, Content::Line { line: 1, left: 2, columns: 2 });
        for (content, bytes) in [(sure, 4), (sure, 5), (sure, 7), (plain, 6)] {
            let mut packet = encoded(&body(content, &[1; 7][..bytes]));
            assert_eq!(Packet::decode(&mut packet), Err(PacketError::Length { columns: 2, bytes }));
        }
        let outside = header(Content::LineWithConfidences { line: 2, left: 0, columns: 1 });
        assert_eq!(Packet::decode(&mut packet(&outside)), Err(PacketError::Outside { header: outside }));
    }

    /// Recorded before packets could carry confidences.
    #[test]
    fn packets_without_confidences_are_as_they_always_were() {
        let header = |content| Header { magic: MAGIC, version: VERSION, sequence: 300, width: 40, height: 20, content };
        let bytes = |content| postcard::to_slice(&header(content), &mut [0; 64]).unwrap().to_vec();
        assert_eq!(bytes(Content::Line { line: 7, left: 3, columns: 30 }), b"mscp\x01\xac\x02\x28\x14\x00\x07\x03\x1e");
        assert_eq!(bytes(Content::End { stack: Some(77) }), b"mscp\x01\xac\x02\x28\x14\x01\x01\x4d");
    }

    /// The headers of a frame's packets, as a sender numbers them.
    fn headers() -> Vec<Header> {
        let mut buffer = vec![0; buffer_bytes(8)];
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        let header = |packet: &[u8]| Packet::decode(&mut packet[..packet.len() - 1].to_vec()).unwrap().header;
        let mut headers: Vec<_> =
            (0..4).map(|v| header(sender.line(&Region::whole(PARAMS.search()), v, &[None; 8]).unwrap())).collect();
        headers.push(header(sender.end(None).unwrap()));
        headers
    }

    #[test]
    fn frames_follow_one_another() {
        let mut receiver = Receiver::default();
        for header in headers().iter().chain(&headers()) {
            assert_eq!(receiver.accept(header), Ok(()));
        }
    }

    #[test]
    fn a_gap_is_reported_once() {
        let sent = headers();
        let mut receiver = Receiver::default();
        assert_eq!(receiver.accept(&sent[0]), Ok(()));
        assert_eq!(receiver.accept(&sent[2]), Err(Lost { expected: 1, found: 2 }));
        assert_eq!(receiver.accept(&sent[3]), Ok(()));
    }
}
