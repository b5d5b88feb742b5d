//! The packets that carry disparities to a host, over anything that carries bytes.
//!
//! A packet holds, in this order:
//! - a [`Header`], encoded by `postcard`,
//! - the disparities of its line, two bytes each, little-endian, as
//!   [`Disparity::to_raw16`](multiscopic_core::Disparity::to_raw16) encodes them,
//! - if the content is a [`LineWithConfidences`](Content::LineWithConfidences), the confidences of these disparities, one byte
//!   each: the probability that a disparity is at most one pixel off, times 255, and 0 where it is invalid,
//! - the CRC-32 of all bytes before it, little-endian.
//!
//! COBS removes the zeros from these bytes, and a zero ends the packet. A receiver that starts late or has
//! lost bytes resumes after the next zero.
//!
//! A receiver of the same version that knows no confidences takes a packet with them for one with an invalid header.
//!
//! ```
//! use multiscopic_core::{Disparity, Fusion, Region};
//! use multiscopic_edge::packet::{Packet, Receiver, Sender, buffer_bytes};
//! use multiscopic_edge::profile::QQVGA;
//!
//! // The microcontroller: a line of disparities of 5 pixels.
//! let (matching, line) = (QQVGA.matching(Fusion::Min), [Disparity::from_bits(5 * 64); 160]);
//! let mut buffer = [0; buffer_bytes(160)];
//! let mut sender = Sender::new(matching.search(), &mut buffer);
//! let mut sent = sender.line(&Region::whole(matching.search()), 0, &line)?.to_vec();
//!
//! // The host: the bytes before a zero are a packet.
//! assert_eq!(sent.pop(), Some(0));
//! let packet = Packet::decode(&mut sent)?;
//! Receiver::default().accept(&packet.header)?; // notices packets that were lost before this one
//! assert!(packet.disparities().eq(line));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod receiver;
mod sender;

pub use receiver::{Lost, Packet, PacketError, Receiver};
pub use sender::{BufferTooSmall, Sender, buffer_bytes, buffer_bytes_with_confidences, max_bytes};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};

/// The first bytes of every packet.
pub const MAGIC: [u8; 4] = *b"mscp";
/// The version of the packet format.
pub const VERSION: u8 = 1;

/// The most bytes of a header: magic and version, then as `postcard` encodes numbers, five for 32 bits, three
/// for 16 bits, and one for the variant of the content.
const MAX_HEADER_BYTES: usize = MAGIC.len() + 1 + 5 + 3 + 3 + 1 + 3 * 3;

/// The header of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Header {
    magic: [u8; 4],
    version: u8,
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
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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

/// The size of the checksum.
const CHECKSUM_BYTES: usize = 4;

/// With one table of 1 KiB, as flash is scarce on a microcontroller.
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// The CRC-32 of `bytes`, as in Ethernet and zip.
fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// The most bytes between two codes.
const MAX_RUN: usize = 254;

/// The most bytes that [`encode`] makes of `bytes`: a code for every 254, one more code, and the final zero.
const fn max_encoded_bytes(bytes: usize) -> usize {
    bytes + bytes.div_ceil(MAX_RUN) + 2
}

/// Encodes `bytes` and the final zero into `encoded`. Returns the length, or nothing if `encoded` is too
/// short.
///
/// The crate `cobs`, which decodes the packets, encodes byte by byte. Zeros are rare in disparities, so this
/// copies the runs between them, which saves a seventh of the instructions that sending a line takes on a
/// Cortex-M4.
fn encode(bytes: &[u8], mut encoded: &mut [u8]) -> Option<usize> {
    let (mut rest, mut len) = (bytes, 0);
    loop {
        let window = rest.get(..MAX_RUN).unwrap_or(rest);
        let run = window.iter().position(|&byte| byte == 0).unwrap_or(window.len());
        let (code, after) = encoded.split_first_mut()?;
        let (copy, after) = after.split_at_mut_checked(run)?;
        *code = run as u8 + 1;
        copy.copy_from_slice(rest.get(..run)?);
        (encoded, len) = (after, len + 1 + run);
        // Every code stands for the zero after its run, except after a run of full length.
        rest = match rest.get(run + usize::from(run < MAX_RUN)..) {
            Some(rest) if run < MAX_RUN || !rest.is_empty() => rest,
            _ => break,
        };
    }
    *encoded.first_mut()? = 0;
    Some(len + 1)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::{vec, vec::Vec};

    #[test]
    fn runs_of_all_lengths_are_decoded_by_the_crate_cobs() {
        for len in (0usize..20).chain(245..270).chain(500..520).chain(755..775) {
            for zeros in
                [vec![], vec![0], vec![253], vec![254], vec![255], vec![len / 2, len / 2 + 1], vec![len.saturating_sub(1)]]
            {
                let bytes: Vec<u8> = (0..len).map(|i| if zeros.contains(&i) { 0 } else { i as u8 | 1 }).collect();
                let mut encoded = vec![0xaa; max_encoded_bytes(len)];
                let end = encode(&bytes, &mut encoded).unwrap();
                let (&mut zero, encoded) = encoded[..end].split_last_mut().unwrap();
                assert!(zero == 0 && !encoded.contains(&0), "{len} bytes, zeros at {zeros:?}");
                let decoded = cobs::decode_in_place(encoded).unwrap();
                assert_eq!(&encoded[..decoded], bytes, "zeros at {zeros:?}");
                assert_eq!(encode(&bytes, &mut vec![0; end - 1]), None);
            }
        }
    }
}
