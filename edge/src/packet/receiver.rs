//! Notices lost packets.

use core::{error, fmt, mem};

use super::format::{Content, Header};

/// Notices packets that are missing between those that arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    use crate::packet::{Packet, Sender, buffer_bytes};
    use multiscopic_core::{BlockMatchingParams, Region, SearchConfig};
    use std::{vec, vec::Vec};

    const SEARCH: SearchConfig = SearchConfig { num_disparities: 4, ..SearchConfig::of_size(8, 4) };
    const PARAMS: BlockMatchingParams = match SEARCH.block_matching(3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

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
