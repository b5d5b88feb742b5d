//! Receiving a frame of disparities, and of their confidences if there are some, from the packets that the firmware sends.
//!
//! Lost and damaged packets do not end the reception: they are reported, and their pixels stay invalid.

mod assembler;

use std::{
    io::{BufRead, Read},
    path::Path,
};

use multiscopic_edge::packet;

use crate::{
    error::{Error, Result},
    files::Limits,
};

use assembler::{Assembler, Piece};

pub use assembler::{Flaw, Notice, PacketId, ReceivedFrame};

/// Give up after this many bytes without a packet: then the stream is something else.
const MAX_NOISE_BYTES: usize = 1 << 20;

/// Reads packets from `source` until the frame or the stream ends, and reports every event to `notify`. If the reception begins in
/// the middle of a frame, it goes on to the end of the next, and takes the one of which more arrives.
/// Messages call the source `path`. A frame has a size within `limits`.
///
/// # Errors
/// The source cannot be read, has no packets of disparities, or has a frame too large for this machine.
pub fn receive(mut source: impl BufRead, path: &Path, limits: Limits, notify: impl FnMut(Notice)) -> Result<ReceivedFrame> {
    let mut assembler = Assembler::new(path, limits, notify);
    let (mut piece, mut noise_bytes, mut bytes) = (Vec::new(), 0, 0);
    while noise_bytes <= MAX_NOISE_BYTES {
        piece.clear();
        let longest = packet::max_bytes(usize::from(u16::MAX)) as u64;
        let read = source.by_ref().take(longest).read_until(0, &mut piece);
        let read = read.map_err(|source| Error::Read { path: path.into(), source })?;
        if read == 0 {
            break;
        }
        (noise_bytes, bytes) = (noise_bytes + read, bytes + read);
        piece.pop_if(|byte| *byte == 0);
        match assembler.process(&mut piece)? {
            Piece::Noise => {}
            Piece::Line => noise_bytes = 0,
            Piece::End | Piece::NextFrame => return assembler.finish(bytes),
        }
    }
    assembler.report_no_end();
    assembler.finish(bytes)
}

#[cfg(test)]
mod tests {
    use multiscopic_core::{BlockMatchingParams, Disparity, Fusion, Region, SearchConfig, valid};
    use multiscopic_edge::packet::{Sender, buffer_bytes, buffer_bytes_with_confidences};

    use super::*;
    use crate::images::{DisparityMap, Raster};

    const SEARCH: SearchConfig = SearchConfig { fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(3, 4) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));

    /// The packets of a frame in two tiles, of two columns and one, and its end. All disparities are 2.
    fn sent() -> Vec<Vec<u8>> {
        let mut buffer = vec![0; buffer_bytes(3)];
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        let lines = Region::tiles(PARAMS.search(), 2).flat_map(|tile| (0..4).map(move |v| (tile, v)));
        let two = Disparity::from_bits(128);
        let mut packets: Vec<_> =
            lines.map(|(tile, v)| sender.line(&tile, v, &vec![two; tile.width()]).unwrap().to_vec()).collect();
        packets.push(sender.end(Some(77)).unwrap().to_vec());
        packets
    }

    /// The frame received from `packets`, its flaws as text, and whether any was harmful.
    fn received(packets: &[Vec<u8>]) -> (ReceivedFrame, Vec<String>, bool) {
        let (mut flaws, mut is_harmed) = (Vec::new(), false);
        let received = receive(&packets.concat()[..], Path::new("stream"), Limits::DEFAULT, |notice| {
            if let Notice::Flaw(flaw) = notice {
                flaws.push(flaw.to_string());
                is_harmed |= flaw.is_harmful();
            }
        });
        (received.unwrap(), flaws, is_harmed)
    }

    fn refusal(bytes: &[u8]) -> String {
        receive(bytes, Path::new("stream"), Limits::DEFAULT, |_| ()).unwrap_err().to_string()
    }

    #[test]
    fn tiles_are_assembled() {
        let (received, flaws, _) = received(&sent());
        assert_eq!(received.disparities, DisparityMap::filled(3, 4, Disparity::from_bits(128)));
        assert_eq!((received.pixels, received.stack, received.is_complete()), (12, Some(77), true));
        assert_eq!(flaws, [""; 0]);
    }

    #[test]
    fn confidences_are_assembled() {
        assert_eq!(received(&sent()).0.confidences, None);
        let whole = Region::whole(PARAMS.search());
        let mut buffer = vec![0; buffer_bytes_with_confidences(3)];
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        let two = [Disparity::from_bits(128); 3];
        let confidences = |v: u8| [v, 255 - v, 0];
        // Line 2 comes without, and line 3 is lost.
        let mut packets: Vec<_> = (0..3)
            .map(|v| match v {
                2 => sender.line(&whole, 2, &two).unwrap().to_vec(),
                _ => sender.line_with_confidences(&whole, v.into(), &two, &confidences(v)).unwrap().to_vec(),
            })
            .collect();
        sender.line(&whole, 3, &two).unwrap();
        packets.push(sender.end(None).unwrap().to_vec());
        let (received, flaws, _) = received(&packets);
        assert_eq!(flaws, ["line 3 (packet 3) is lost"]);
        let expected = [confidences(0), confidences(1), [0; 3], [0; 3]].concat();
        assert_eq!(received.confidences, Some(Raster::new(3, 4, expected)));
    }

    #[test]
    fn missing_packets_are_reported_and_their_pixels_invalid() {
        for (missing, pixels, expected) in [
            (0..1, 10, &["line 0 (packet 0) is lost, or sent before the reception began"][..]),
            (1..3, 8, &["lines 1 to 2 (packets 1 to 2) are lost"]),
            (3..6, 8, &["line 3 (packet 3) is lost", "lines 0 to 1 (packets 4 to 5) are lost"]),
            (7..8, 11, &["line 3 (packet 7) is lost"]),
            (8..9, 12, &["the end of the frame is lost: nothing came after line 3 (packet 7)"]),
        ] {
            let mut packets = sent();
            packets.drain(missing.clone());
            let (received, flaws, is_harmed) = received(&packets);
            assert_eq!((flaws, is_harmed, received.pixels), (expected.iter().map(|&flaw| flaw.into()).collect(), true, pixels));
            let invalid = received.disparities.pixels().iter().filter(|pixel| pixel.is_none()).count();
            assert_eq!(invalid, 12 - pixels, "without {missing:?}");
        }
    }

    #[test]
    fn damaged_packets_are_identified() {
        for (i, place) in [(0, "line 0 (packet 0)"), (6, "line 2 (packet 6)")] {
            let mut packets = sent();
            packets[i][12] ^= 0x40;
            let (_, flaws, is_harmed) = received(&packets);
            assert!(is_harmed && flaws.len() == 1, "{flaws:?}");
            assert!(flaws[0].starts_with(&format!("{place} is damaged: a damaged packet: ")), "{flaws:?}");
        }
        // One of two missing packets arrives damaged: it is not known which.
        let mut packets = sent();
        packets.remove(2);
        packets[2][12] ^= 0x40;
        let (_, flaws, _) = received(&packets);
        assert!(flaws[0].starts_with("after line 1 (packet 1): a damaged packet: "), "{flaws:?}");
        assert_eq!(flaws[1..], ["lines 2 to 3 (packets 2 to 3) are lost"]);
    }

    #[test]
    fn a_broken_stream_gives_what_arrived() {
        let mut packets = sent();
        packets.truncate(6);
        packets[5].truncate(9);
        let (received, flaws, is_harmed) = received(&packets);
        assert_eq!((received.pixels, received.stack, is_harmed), (9, None, true));
        assert!(flaws[0].starts_with("after line 0 (packet 4): a damaged packet: "), "{flaws:?}");
        assert_eq!(flaws[1..], ["the end of the frame is lost: nothing came after line 0 (packet 4)"]);
    }

    #[test]
    fn packets_of_other_frames_do_no_harm() {
        let mut packets = sent();
        let other =
            SearchConfig { fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(9, 9) }.block_matching(3).unwrap();
        let mut buffer = vec![0; buffer_bytes(9)];
        let line = Sender::new(other.search(), &mut buffer).line(&Region::whole(other.search()), 0, &[None; 9]).unwrap().to_vec();
        packets.insert(3, line);
        packets.insert(1, vec![0; 5]);
        let (received, flaws, is_harmed) = received(&packets);
        assert!(received.is_complete() && !is_harmed);
        assert_eq!(flaws, ["ignored a packet of another frame: 9x9 pixels instead of 3x4"]);
    }

    #[test]
    fn the_next_frame_replaces_one_that_began_before_the_reception() {
        let lost = "lines 0 to 2 (packets 0 to 2) are lost, or sent before the reception began".to_owned();
        let late = sent().split_off(3);
        let without = |removed: usize| [&late[..], &sent()[..removed], &sent()[removed + 1..]].concat();
        for (packets, pixels, expected) in [
            // The end of the first frame, then a whole frame, with or without the packet between them.
            ([&late[..], &sent()[..]].concat(), 12, vec![]),
            ([&late[..5], &sent()[..]].concat(), 12, vec![]),
            // The next frame lacks a line, or has no beginning either.
            (without(1), 10, vec!["line 1 (packet 1) is lost".to_owned()]),
            (without(0), 10, vec!["line 0 (packet 0) is lost, or sent before the reception began".into()]),
            // No frame follows, or less of it than there was.
            (late.clone(), 6, vec![lost.clone()]),
            ([&late[..], &sent()[..2]].concat(), 6, vec![lost.clone()]),
            (
                late[..5].to_vec(),
                6,
                vec![lost.clone(), "the end of the frame is lost: nothing came after line 3 (packet 7)".into()],
            ),
        ] {
            let (received, flaws, is_harmed) = received(&packets);
            assert_eq!((received.pixels, &flaws, is_harmed), (pixels, &expected, !expected.is_empty()));
        }
    }

    #[test]
    fn the_next_frame_is_kept_out() {
        let mut packets = sent();
        packets.truncate(6);
        packets.extend(sent());
        let (received, flaws, _) = received(&packets);
        assert_eq!(received.pixels, 10);
        assert_eq!(flaws, ["the end of the frame is lost: nothing came after line 1 (packet 5)"]);
        // Nothing is read after the end.
        let mut packets = sent();
        packets.push(b"noise".to_vec());
        assert_eq!(super::tests::received(&packets).1, [""; 0]);
    }

    #[test]
    fn other_streams_are_refused() {
        assert!(refusal(b"").starts_with("stream: found nothing, expected the packets"), "{}", refusal(b""));
        let text = refusal(b"no packets here");
        assert!(text.contains("found 15 bytes without a packet of disparities (the first error: a damaged packet"), "{text}");
        let endless =
            |byte| receive(std::io::BufReader::new(std::io::repeat(byte)), Path::new("stream"), Limits::DEFAULT, |_| ()).is_err();
        assert!(endless(0) && endless(1) && endless(b'x'));
    }
}
