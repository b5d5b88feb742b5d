//! Encodes packets.

use core::{error, fmt};
use multiscopic_core::{Disparity, Region, SearchSpace};

use super::{CHECKSUM_BYTES, Content, Header, MAGIC, MAX_HEADER_BYTES, VERSION, checksum, encode, max_encoded_bytes};

/// The most bytes of a packet with `columns` disparities and their confidences.
pub const fn max_bytes(columns: usize) -> usize {
    max_encoded_bytes(max_plain_bytes(columns, columns))
}

/// The length of the buffer of a [`Sender`] for packets of up to `columns` disparities without confidences.
///
/// The buffer holds a packet twice, before and after COBS.
pub const fn buffer_bytes(columns: usize) -> usize {
    buffer_bytes_of(columns, 0)
}

/// The same for packets with the confidences of these disparities.
pub const fn buffer_bytes_with_confidences(columns: usize) -> usize {
    buffer_bytes_of(columns, columns)
}

const fn buffer_bytes_of(disparities: usize, confidences: usize) -> usize {
    let plain = max_plain_bytes(disparities, confidences);
    plain + max_encoded_bytes(plain)
}

const fn max_plain_bytes(disparities: usize, confidences: usize) -> usize {
    MAX_HEADER_BYTES + 2 * disparities + confidences + CHECKSUM_BYTES
}

/// Encodes the packets of a frame in a buffer that it borrows.
#[derive(Debug)]
pub struct Sender<'b> {
    buffer: &'b mut [u8],
    width: u16,
    height: u16,
    sequence: u32,
}

impl<'b> Sender<'b> {
    /// A sender for a frame of the size in `search`. The buffer needs [`buffer_bytes`] of the widest
    /// line, or [`buffer_bytes_with_confidences`].
    pub fn new(search: &SearchSpace, buffer: &'b mut [u8]) -> Sender<'b> {
        Sender::from_packet(0, search, buffer)
    }

    /// A sender that goes on after the first `sequence` packets of a frame, which another has encoded.
    pub fn from_packet(sequence: u32, search: &SearchSpace, buffer: &'b mut [u8]) -> Sender<'b> {
        Sender { buffer, width: search.width() as u16, height: search.height() as u16, sequence }
    }

    /// Encodes the disparities of `line` in the columns of `region`.
    ///
    /// # Errors
    /// [`BufferTooSmall`].
    pub fn line(&mut self, region: &Region, line: usize, disparities: &[Option<Disparity>]) -> Result<&[u8], BufferTooSmall> {
        let (left, columns) = (region.columns().start as u16, disparities.len() as u16);
        self.packet(Content::Line { line: line as u16, left, columns }, disparities, &[])
    }

    /// [`line`](Sender::line) with the confidences of these disparities. If they are not as many, receivers refuse the packet.
    ///
    /// # Errors
    /// [`BufferTooSmall`].
    pub fn line_with_confidences(
        &mut self,
        region: &Region,
        line: usize,
        disparities: &[Option<Disparity>],
        confidences: &[u8],
    ) -> Result<&[u8], BufferTooSmall> {
        let (left, columns) = (region.columns().start as u16, disparities.len() as u16);
        self.packet(Content::LineWithConfidences { line: line as u16, left, columns }, disparities, confidences)
    }

    /// Encodes the end of the frame, with the greatest depth of the stack in bytes if it was measured.
    ///
    /// # Errors
    /// [`BufferTooSmall`].
    pub fn end(&mut self, stack: Option<usize>) -> Result<&[u8], BufferTooSmall> {
        self.packet(Content::End { stack: stack.map(|bytes| bytes as u32) }, &[], &[])
    }

    fn packet(
        &mut self,
        content: Content,
        disparities: &[Option<Disparity>],
        confidences: &[u8],
    ) -> Result<&[u8], BufferTooSmall> {
        let [of_disparities, of_confidences] = [2 * disparities.len(), confidences.len()];
        let too_small = BufferTooSmall { needed: buffer_bytes_of(disparities.len(), of_confidences), given: self.buffer.len() };
        if too_small.given < too_small.needed {
            return Err(too_small);
        }
        let (plain, encoded) =
            self.buffer.split_at_mut_checked(max_plain_bytes(disparities.len(), of_confidences)).ok_or(too_small)?;
        let &mut Sender { width, height, sequence, .. } = self;
        let header = Header { magic: MAGIC, version: VERSION, sequence, width, height, content };
        let header_bytes = postcard::to_slice(&header, plain).map_err(|_| too_small)?.len();
        let samples = plain.get_mut(header_bytes..).unwrap_or_default();
        for (sample, &disparity) in samples.chunks_exact_mut(2).zip(disparities) {
            sample.copy_from_slice(&Disparity::to_raw16(disparity).to_le_bytes());
        }
        let after = samples.get_mut(of_disparities..of_disparities + of_confidences).ok_or(too_small)?;
        after.copy_from_slice(confidences);
        let (body, rest) = plain.split_at_mut_checked(header_bytes + of_disparities + of_confidences).ok_or(too_small)?;
        rest.get_mut(..CHECKSUM_BYTES).ok_or(too_small)?.copy_from_slice(&checksum(body).to_le_bytes());
        let len = body.len() + CHECKSUM_BYTES;
        let len = encode(plain.get(..len).ok_or(too_small)?, encoded).ok_or(too_small)?;
        self.sequence += 1;
        encoded.get(..len).ok_or(too_small)
    }
}

/// The buffer is too small for a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::packet::Packet;
    use multiscopic_core::{BlockMatchingParams, SearchConfig, valid};
    use std::{vec, vec::Vec};

    const SEARCH: SearchConfig = SearchConfig { num_disparities: 4, ..SearchConfig::of_size(700, 20) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));

    /// A line in which many bytes are zero.
    fn line(columns: usize) -> Vec<Option<Disparity>> {
        (0..columns)
            .map(|u| Disparity::from_raw16((u * 2731 % 65536) as u16 & if u % 3 == 0 { 0xff00 } else { 0xffff }))
            .collect()
    }

    /// Confidences, of which some are zero.
    fn confidences(columns: usize) -> Vec<u8> {
        (0..columns).map(|u| if u % 5 == 0 { 0 } else { u as u8 }).collect()
    }

    fn sent(columns: usize, confidences: Option<&[u8]>) -> Vec<u8> {
        let mut buffer = vec![0; if confidences.is_some() { buffer_bytes_with_confidences } else { buffer_bytes }(columns)];
        let region = Region::new(PARAMS.search(), 3..3 + columns, 0..20).unwrap();
        let mut sender = Sender { sequence: u32::MAX - 1, ..Sender::new(PARAMS.search(), &mut buffer) };
        match confidences {
            Some(confidences) => sender.line_with_confidences(&region, 7, &line(columns), confidences),
            None => sender.line(&region, 7, &line(columns)),
        }
        .unwrap()
        .to_vec()
    }

    #[test]
    fn decoding_restores_the_line() {
        for columns in [1, 2, 100, 113, 114, 115, 127, 128, 240, 241, 697] {
            let (all, line_number, left) = (confidences(columns), 7, 3);
            for confidences in [None, Some(&all[..])] {
                let mut bytes = sent(columns, confidences);
                assert!(bytes.len() <= max_bytes(columns), "{} bytes of {columns} columns", bytes.len());
                assert_eq!(bytes.pop(), Some(0));
                assert!(!bytes.contains(&0));
                let packet = Packet::decode(&mut bytes).unwrap();
                assert_eq!((packet.header.width, packet.header.height), (700, 20));
                let columns = columns as u16;
                let content = match confidences {
                    Some(_) => Content::LineWithConfidences { line: line_number, left, columns },
                    None => Content::Line { line: line_number, left, columns },
                };
                assert_eq!(packet.header.content, content);
                assert!(packet.disparities().eq(line(columns.into())));
                assert_eq!(packet.confidences(), confidences.unwrap_or_default());
            }
        }
    }

    #[test]
    fn a_small_buffer_is_refused() {
        let mut buffer = vec![0; buffer_bytes(3)];
        let given = buffer.len();
        let region = Region::new(PARAMS.search(), 0..4, 0..20).unwrap();
        let error = Sender::new(PARAMS.search(), &mut buffer).line(&region, 0, &line(4)).map(<[u8]>::len);
        assert_eq!(error, Err(BufferTooSmall { needed: buffer_bytes(4), given }));
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        let error = sender.line_with_confidences(&region, 0, &line(3), &confidences(3)).map(<[u8]>::len);
        assert_eq!(error, Err(BufferTooSmall { needed: buffer_bytes_with_confidences(3), given }));
    }
}
