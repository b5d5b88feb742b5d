//! The packets that bring disparities to a host over anything that carries bytes.
//!
//! A packet is a [`Header`] as `postcard` writes it, the disparities of its line, two bytes each, little-endian, as
//! [`Disparity::to_raw16`] encodes them, and the CRC-32 of all that, little-endian. COBS takes the zeros out of these bytes, and a
//! zero ends the packet. So a receiver that comes late or has lost bytes goes on at the next zero.

use core::{error, fmt};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use multiscopic_core::{Disparity, Params, Region};
use serde::{Deserialize, Serialize};

/// What every packet begins with.
pub const MAGIC: [u8; 4] = *b"mscp";
/// The version of this format.
pub const VERSION: u8 = 1;

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);
const CRC_BYTES: usize = 4;

/// The most bytes that a header takes: magic, version, and seven numbers as `postcard` writes them.
const MAX_HEADER_BYTES: usize = MAGIC.len() + 1 + 5 + 3 + 3 + 1 + 3 * 3;

/// The most bytes of a packet with `columns` disparities.
pub const fn max_bytes(columns: usize) -> usize {
    let bytes = max_plain_bytes(columns);
    // COBS adds a byte for every 254 and one more, the packet's end another.
    bytes + bytes.div_ceil(254) + 2
}

/// The length of the buffer that [`Sender`] encodes packets with `columns` disparities in: twice, before and after COBS.
pub const fn buffer_bytes(columns: usize) -> usize {
    max_plain_bytes(columns) + max_bytes(columns)
}

const fn max_plain_bytes(columns: usize) -> usize {
    MAX_HEADER_BYTES + 2 * columns + CRC_BYTES
}

/// What a packet says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    magic: [u8; 4],
    version: u8,
    /// Counts packets, from 0 for a frame's first.
    pub sequence: u32,
    /// Pixels in a line of the frame.
    pub width: u16,
    /// Lines of the frame.
    pub height: u16,
    /// What the packet is.
    pub content: Content,
}

/// What a packet brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Content {
    /// A line of disparities.
    Line {
        /// Its number in the frame.
        line: u16,
        /// The frame's column that it begins in.
        left: u16,
        /// How many columns it has.
        columns: u16,
    },
    /// The frame's end.
    End {
        /// The greatest depth of the sender's stack, in bytes, if the sender measures it: a host that simulates one does not.
        stack: Option<u32>,
    },
}

/// Encodes the packets of a frame, in a buffer of its own.
#[derive(Debug)]
pub struct Sender<'b> {
    buffer: &'b mut [u8],
    width: u16,
    height: u16,
    sequence: u32,
}

impl<'b> Sender<'b> {
    /// A sender for a frame as large as `params` say. The buffer's length is [`buffer_bytes`] of the longest line.
    pub fn new(params: &Params, buffer: &'b mut [u8]) -> Sender<'b> {
        Sender { buffer, width: params.width() as u16, height: params.height() as u16, sequence: 0 }
    }

    /// The packet of `line` in the columns of `region`.
    ///
    /// # Errors
    /// [`BufferTooSmall`].
    pub fn line(&mut self, region: &Region, line: usize, disparities: &[Option<Disparity>]) -> Result<&[u8], BufferTooSmall> {
        let (left, columns) = (region.columns().start as u16, disparities.len() as u16);
        self.packet(Content::Line { line: line as u16, left, columns }, disparities)
    }

    /// The packet that ends the frame.
    ///
    /// # Errors
    /// [`BufferTooSmall`].
    pub fn end(&mut self, stack: Option<usize>) -> Result<&[u8], BufferTooSmall> {
        self.packet(Content::End { stack: stack.map(|bytes| bytes as u32) }, &[])
    }

    fn packet(&mut self, content: Content, disparities: &[Option<Disparity>]) -> Result<&[u8], BufferTooSmall> {
        let too_small = BufferTooSmall { needed: buffer_bytes(disparities.len()), given: self.buffer.len() };
        if too_small.given < too_small.needed {
            return Err(too_small);
        }
        let (plain, framed) = self.buffer.split_at_mut_checked(max_plain_bytes(disparities.len())).ok_or(too_small)?;
        let &mut Sender { width, height, sequence, .. } = self;
        let header = Header { magic: MAGIC, version: VERSION, sequence, width, height, content };
        let header = postcard::to_slice(&header, plain).map_err(|_| too_small)?.len();
        let body = plain.get_mut(header..).unwrap_or_default();
        for (bytes, &pixel) in body.chunks_exact_mut(2).zip(disparities) {
            bytes.copy_from_slice(&Disparity::to_raw16(pixel).to_le_bytes());
        }
        let (body, rest) = plain.split_at_mut_checked(header + 2 * disparities.len()).ok_or(too_small)?;
        rest.get_mut(..CRC_BYTES).ok_or(too_small)?.copy_from_slice(&CRC.checksum(body).to_le_bytes());
        let len = body.len() + CRC_BYTES;
        let len = frame(plain.get(..len).ok_or(too_small)?, framed).ok_or(too_small)?;
        self.sequence += 1;
        framed.get(..len).ok_or(too_small)
    }
}

/// Takes the zeros out of `bytes`, ends them with one, and returns how many these are: COBS run by run, since zeros are rare.
fn frame(bytes: &[u8], mut framed: &mut [u8]) -> Option<usize> {
    /// The most bytes in a run.
    const RUN: usize = 254;
    let (mut rest, mut len) = (bytes, 0);
    loop {
        let most = rest.get(..RUN).unwrap_or(rest);
        let run = most.iter().position(|&byte| byte == 0).unwrap_or(most.len());
        let (code, after) = framed.split_first_mut()?;
        let (to, after) = after.split_at_mut_checked(run)?;
        *code = run as u8 + 1;
        to.copy_from_slice(rest.get(..run)?);
        (framed, len) = (after, len + 1 + run);
        // A run of the most bytes is not followed by a zero that was taken out.
        rest = match rest.get(run + usize::from(run < RUN)..) {
            Some(rest) if run < RUN || !rest.is_empty() => rest,
            _ => break,
        };
    }
    *framed.first_mut()? = 0;
    Some(len + 1)
}

/// The buffer is too small for a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferTooSmall {
    /// Bytes needed.
    pub needed: usize,
    /// Bytes given.
    pub given: usize,
}

impl fmt::Display for BufferTooSmall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a packet needs a buffer of {} bytes, {} were given", self.needed, self.given)
    }
}

impl error::Error for BufferTooSmall {}

/// A packet that arrived whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// What it says about itself.
    pub header: Header,
    disparities: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Decodes a packet in place: the bytes before the zero that ends it.
    ///
    /// # Errors
    /// The bytes are damaged, or are no packet of this version.
    pub fn decode(bytes: &'a mut [u8]) -> Result<Packet<'a>, PacketError> {
        let len = cobs::decode_in_place(bytes).map_err(|_| PacketError::Framing)?;
        let bytes = bytes.get(..len).unwrap_or_default();
        let (bytes, &crc) = bytes.split_last_chunk::<CRC_BYTES>().ok_or(PacketError::Framing)?;
        let (expected, found) = (u32::from_le_bytes(crc), CRC.checksum(bytes));
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
        let (header, disparities) = postcard::take_from_bytes::<Header>(bytes).map_err(|_| PacketError::Header)?;
        let columns = match header.content {
            Content::Line { line, left, columns } => {
                if line >= header.height || u32::from(left) + u32::from(columns) > u32::from(header.width) {
                    return Err(PacketError::Outside { header });
                }
                columns.into()
            }
            Content::End { .. } => 0,
        };
        if disparities.len() != 2 * columns {
            return Err(PacketError::Length { columns, bytes: disparities.len() });
        }
        Ok(Packet { header, disparities })
    }

    /// The disparities of its line.
    pub fn disparities(&self) -> impl ExactSizeIterator<Item = Option<Disparity>> + use<'a> {
        self.disparities.as_chunks().0.iter().map(|&bytes| Disparity::from_raw16(u16::from_le_bytes(bytes)))
    }
}

/// Notices packets that are missing between those that arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Receiver {
    next: u32,
}

impl Receiver {
    /// A packet arrived. The next one expected is its successor, whatever is missing before.
    ///
    /// # Errors
    /// [`Lost`].
    pub fn accept(&mut self, header: &Header) -> Result<(), Lost> {
        let expected = core::mem::replace(
            &mut self.next,
            match header.content {
                Content::Line { .. } => header.sequence.wrapping_add(1),
                Content::End { .. } => 0,
            },
        );
        if header.sequence == expected { Ok(()) } else { Err(Lost { expected, found: header.sequence }) }
    }
}

/// Packets were lost between two that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost {
    /// The number of the packet that was to come.
    pub expected: u32,
    /// The number of the one that came.
    pub found: u32,
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "packets were lost: number {} was expected, number {} came", self.expected, self.found)
    }
}

impl error::Error for Lost {}

/// Why bytes are not a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PacketError {
    /// They are not what COBS makes: some are missing.
    Framing,
    /// The checksum is wrong.
    Damaged {
        /// The checksum in the packet.
        expected: u32,
        /// The checksum of its bytes.
        found: u32,
    },
    /// They are whole, but from something else.
    Foreign,
    /// They are of another version of this format.
    Version {
        /// That version.
        found: u8,
    },
    /// The header is not what this version has.
    Header,
    /// The line lies outside its frame.
    Outside {
        /// The header that says so.
        header: Header,
    },
    /// There are more or fewer disparities than columns.
    Length {
        /// The columns that the header says.
        columns: usize,
        /// The bytes after the header.
        bytes: usize,
    },
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PacketError::Framing => write!(f, "a damaged packet: bytes of it are missing"),
            PacketError::Damaged { expected, found } => {
                write!(f, "a damaged packet: its checksum is {found:08x}, it was sent with {expected:08x}")
            }
            PacketError::Foreign => write!(f, "not a packet of disparities"),
            PacketError::Version { found } => write!(f, "a packet of version {found}, expected version {VERSION}"),
            PacketError::Header => write!(f, "a packet whose header cannot be read"),
            PacketError::Outside { header } => {
                write!(f, "{:?} lies outside a frame of {}x{} pixels", header.content, header.width, header.height)
            }
            PacketError::Length { columns, bytes } => {
                write!(f, "a packet of {columns} columns with {bytes} bytes of disparities")
            }
        }
    }
}

impl error::Error for PacketError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use multiscopic_core::{Fusion, Views};
    use std::{vec, vec::Vec};

    const PARAMS: Params = match Params::new(700, 20, Views::ALL, Fusion::Heuristic, 1, 4, 3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

    /// Lines of all lengths, with pixels whose bytes are zero among others.
    fn line(columns: usize) -> Vec<Option<Disparity>> {
        (0..columns)
            .map(|u| Disparity::from_raw16((u * 2731 % 65536) as u16 & if u % 3 == 0 { 0xff00 } else { 0xffff }))
            .collect()
    }

    fn sent(columns: usize) -> Vec<u8> {
        let mut buffer = vec![0; buffer_bytes(columns)];
        let region = Region::new(&PARAMS, 3..3 + columns, 0..20).unwrap();
        let mut sender = Sender { sequence: u32::MAX - 1, ..Sender::new(&PARAMS, &mut buffer) };
        sender.line(&region, 7, &line(columns)).unwrap().to_vec()
    }

    #[test]
    fn lines_come_back() {
        for columns in [1, 2, 100, 113, 114, 115, 127, 128, 240, 241, 697] {
            let mut bytes = sent(columns);
            assert!(bytes.len() <= max_bytes(columns), "{} bytes of {columns} columns", bytes.len());
            assert_eq!(bytes.pop(), Some(0));
            assert!(!bytes.contains(&0));
            let packet = Packet::decode(&mut bytes).unwrap();
            assert_eq!((packet.header.width, packet.header.height), (700, 20));
            assert_eq!(packet.header.content, Content::Line { line: 7, left: 3, columns: columns as u16 });
            assert!(packet.disparities().eq(line(columns)));
        }
    }

    #[test]
    fn runs_of_all_lengths_are_framed() {
        for len in (0usize..20).chain(245..270).chain(500..520).chain(755..775) {
            for zeros in
                [vec![], vec![0], vec![253], vec![254], vec![255], vec![len / 2, len / 2 + 1], vec![len.saturating_sub(1)]]
            {
                let bytes: Vec<u8> = (0..len).map(|i| if zeros.contains(&i) { 0 } else { i as u8 | 1 }).collect();
                let mut framed = vec![0xaa; max_bytes(len / 2 + 1)];
                let end = frame(&bytes, &mut framed).unwrap();
                let (&mut zero, framed) = framed[..end].split_last_mut().unwrap();
                assert!(zero == 0 && !framed.contains(&0), "{len} bytes, zeros at {zeros:?}");
                let decoded = cobs::decode_in_place(framed).unwrap();
                assert_eq!(&framed[..decoded], bytes, "zeros at {zeros:?}");
                assert_eq!(frame(&bytes, &mut vec![0; end - 1]), None);
            }
        }
    }

    #[test]
    fn no_damaged_bit_goes_unnoticed() {
        let bytes = sent(30);
        let bytes = &bytes[..bytes.len() - 1];
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
    fn other_packets_are_named() {
        let encoded = |bytes: &[u8]| {
            let mut framed = vec![0; 100];
            let bytes = [bytes, &CRC.checksum(bytes).to_le_bytes()].concat();
            let len = cobs::encode(&bytes, &mut framed);
            framed.truncate(len);
            framed
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
    }

    #[test]
    fn lost_packets_are_noticed_once() {
        let mut buffer = vec![0; buffer_bytes(4)];
        let mut sender = Sender::new(&PARAMS, &mut buffer);
        let region = Region::new(&PARAMS, 0..4, 0..20).unwrap();
        let mut sent: Vec<Header> = Vec::new();
        for v in 0..4 {
            let mut bytes = sender.line(&region, v, &line(4)).unwrap().to_vec();
            bytes.pop();
            sent.push(Packet::decode(&mut bytes).unwrap().header);
        }
        let mut receiver = Receiver::default();
        assert_eq!(receiver.accept(&sent[0]), Ok(()));
        assert_eq!(receiver.accept(&sent[2]), Err(Lost { expected: 1, found: 2 }));
        assert_eq!(receiver.accept(&sent[3]), Ok(()));
    }

    #[test]
    fn a_small_buffer_is_refused() {
        let mut buffer = vec![0; buffer_bytes(3)];
        let given = buffer.len();
        let region = Region::new(&PARAMS, 0..4, 0..20).unwrap();
        let error = Sender::new(&PARAMS, &mut buffer).line(&region, 0, &line(4)).map(<[u8]>::len);
        assert_eq!(error, Err(BufferTooSmall { needed: buffer_bytes(4), given }));
    }
}
