//! A frame of disparities, put together from the packets that firmware sends.

use std::{
    fmt,
    io::{BufRead, Read},
    mem,
    ops::Range,
    path::Path,
};

use multiscopic_core::Disparity;
use multiscopic_edge::packet::{self, Content, Lost, Packet, PacketError, Receiver};

use crate::{
    error::{Error, Result},
    files::input,
    images::{DisparityMap, Raster},
};

/// The most bytes that are read without a packet among them: then the stream is something else.
const MAX_NOISE: usize = 1 << 20;

/// A frame as it came.
#[derive(Clone, Debug, PartialEq)]
pub struct Received {
    /// The disparities; pixels that did not come are invalid.
    pub disparities: DisparityMap,
    /// How many pixels came.
    pub pixels: usize,
    /// The greatest depth of the sender's stack in bytes, if it measures it.
    pub stack: Option<usize>,
}

impl Received {
    /// Whether every pixel came.
    pub fn is_complete(&self) -> bool {
        self.pixels == self.disparities.pixels().len()
    }
}

/// What is told while packets come in.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// A line came.
    Line {
        /// How many of the frame's pixels are there now.
        pixels: usize,
        /// How many it has.
        of: usize,
    },
    /// A packet did not come as it was sent.
    Flaw(Flaw),
}

/// What happened to packets.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Flaw {
    /// A packet arrived damaged.
    Damaged {
        /// Which one, where as many are missing as are damaged.
        packet: Option<Place>,
        /// The packet that came before it.
        after: Option<Place>,
        /// How that was noticed.
        error: PacketError,
    },
    /// Packets of consecutive lines are missing.
    Lost {
        /// The first.
        first: Place,
        /// The last.
        last: Place,
    },
    /// The packet that ends the frame is missing.
    NoEnd {
        /// The last packet that came.
        after: Place,
    },
    /// A whole packet that is not one of disparities, or contradicts itself.
    Foreign {
        /// The packet that came before it.
        after: Option<Place>,
        /// What is wrong with it.
        error: PacketError,
    },
    /// A packet of a frame of another size.
    OtherFrame {
        /// Width and height of that frame.
        found: [usize; 2],
        /// Width and height of the frame that is received.
        expected: [usize; 2],
    },
    /// A packet brought pixels that were there already.
    Again(Place),
}

impl Flaw {
    /// Whether something is missing of the frame, or may be wrong: not so if packets of something else came in between.
    pub fn is_harmful(&self) -> bool {
        !matches!(self, Flaw::Foreign { .. } | Flaw::OtherFrame { .. })
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let behind = |after: &Option<Place>| after.map_or("before the first line".into(), |place| format!("after {place}"));
        match self {
            Flaw::Damaged { packet: Some(packet), error, .. } => write!(f, "{packet} is damaged: {error}"),
            Flaw::Damaged { after, error, .. } => write!(f, "{}: {error}", behind(after)),
            Flaw::Lost { first, last } if first == last => write!(f, "{first} is lost"),
            Flaw::Lost { first, last } => {
                write!(f, "lines {} to {} (packets {} to {}) are lost", first.line, last.line, first.sequence, last.sequence)
            }
            Flaw::NoEnd { after } => write!(f, "the end of the frame is lost: nothing came after {after}"),
            Flaw::Foreign { after, error } => write!(f, "foreign data {}: {error}", behind(after)),
            Flaw::OtherFrame { found: [w, h], expected: [width, height] } => {
                write!(f, "a foreign packet: of a frame of {w}x{h} pixels, this one has {width}x{height}")
            }
            Flaw::Again(packet) => write!(f, "{packet} brought pixels that were there already"),
        }
    }
}

/// A packet's place in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Its line. A frame in column tiles has each line once for every tile.
    pub line: u32,
    /// Its number, from 0.
    pub sequence: u32,
}

impl Place {
    /// Every tile has a packet for each line of the frame.
    fn of(sequence: u32, height: u32) -> Place {
        Place { line: sequence % height, sequence }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {} (packet {})", self.line, self.sequence)
    }
}

/// Reads packets from `source` until a frame ends, or the stream does, and tells `notice` of everything that happens. Messages call
/// the source `path`.
///
/// # Errors
/// The source cannot be read, or brings no packets of disparities.
pub fn receive(mut source: impl BufRead, path: &Path, notice: impl FnMut(Notice)) -> Result<Received> {
    let mut reception = Reception { receiver: Receiver::default(), frame: None, noise: Vec::new(), notice };
    let (mut piece, mut without_packet, mut bytes) = (Vec::new(), 0, 0);
    while without_packet <= MAX_NOISE {
        piece.clear();
        let longest = packet::max_bytes(usize::from(u16::MAX)) as u64;
        let read = source.by_ref().take(longest).read_until(0, &mut piece);
        let read = read.map_err(|source| Error::Read { path: path.into(), source })?;
        if read == 0 {
            break;
        }
        (without_packet, bytes) = (without_packet + read, bytes + read);
        piece.pop_if(|byte| *byte == 0);
        match reception.take(&mut piece, path)? {
            Taken::Noise => {}
            Taken::Line => without_packet = 0,
            Taken::End { stack } => return reception.finish(stack, path, bytes),
            Taken::NextFrame => break,
        }
    }
    reception.break_off();
    reception.finish(None, path, bytes)
}

/// What a piece of the stream is.
enum Taken {
    Noise,
    Line,
    End { stack: Option<u32> },
    NextFrame,
}

/// A frame on its way.
struct Reception<N> {
    receiver: Receiver,
    frame: Option<Incoming>,
    /// The pieces since the last packet that are none of disparities, and why.
    noise: Vec<PacketError>,
    notice: N,
}

/// The part of a frame that is there.
struct Incoming {
    pixels: Raster<Option<Option<Disparity>>>,
    came: usize,
    /// The last packet.
    last: Option<Place>,
}

impl<N: FnMut(Notice)> Reception<N> {
    /// Takes what came between two zeros.
    fn take(&mut self, piece: &mut [u8], path: &Path) -> Result<Taken> {
        if piece.is_empty() {
            return Ok(Taken::Noise);
        }
        let decoded = Packet::decode(piece).and_then(|packet| match packet.header {
            // The narrowest tiles make a packet of each pixel.
            header if u64::from(header.sequence) > u64::from(header.width) * u64::from(header.height) => {
                Err(PacketError::Outside { header })
            }
            _ => Ok(packet),
        });
        let packet = match decoded {
            Ok(packet) => packet,
            Err(error) => {
                self.noise.push(error);
                return Ok(Taken::Noise);
            }
        };
        let size = [packet.header.width, packet.header.height].map(usize::from);
        let frame = match &mut self.frame {
            Some(frame) => frame,
            None => self.frame.insert(Incoming::new(size, path)?),
        };
        let expected = frame.size();
        if size != expected {
            self.tell(Flaw::OtherFrame { found: size, expected });
            return Ok(Taken::Noise);
        }
        match self.receiver.accept(&packet.header) {
            Ok(()) => self.explain(0..0),
            Err(Lost { expected, found }) if found < expected => return Ok(Taken::NextFrame),
            Err(Lost { expected, found }) => self.explain(expected..found),
        }
        match packet.header.content {
            Content::Line { line, left, .. } => {
                self.put(Place { line: line.into(), sequence: packet.header.sequence }, left.into(), packet.disparities());
                Ok(Taken::Line)
            }
            Content::End { stack } => Ok(Taken::End { stack }),
        }
    }

    /// Tells what became of the packets `missing` before the one that has just come.
    fn explain(&mut self, missing: Range<u32>) {
        let Some(frame) = &self.frame else { return };
        let (after, height) = (frame.last, frame.size()[1] as u32);
        let noise = mem::take(&mut self.noise);
        let is_damaged = |error: &PacketError| matches!(error, PacketError::Framing | PacketError::Damaged { .. });
        // Only then is it known which packet is which.
        let known = noise.iter().filter(|error| is_damaged(error)).count() == missing.len();
        let mut packets = missing.clone().map(|sequence| Place::of(sequence, height)).filter(|_| known);
        for error in noise {
            self.tell(match is_damaged(&error) {
                true => Flaw::Damaged { packet: packets.next(), after, error },
                false => Flaw::Foreign { after, error },
            });
        }
        // The lines of one tile after the other.
        let mut rest = if known { 0..0 } else { missing };
        while !rest.is_empty() {
            let end = (rest.start / height + 1).saturating_mul(height).min(rest.end);
            let [first, last] = [rest.start, end - 1].map(|sequence| Place::of(sequence, height));
            self.tell(Flaw::Lost { first, last });
            rest.start = end;
        }
    }

    /// Puts a line's disparities where they belong.
    fn put(&mut self, place: Place, left: usize, disparities: impl Iterator<Item = Option<Disparity>>) {
        let Some(frame) = &mut self.frame else { return };
        let mut again = false;
        for (pixel, disparity) in frame.pixels.row_mut(place.line as usize)[left..].iter_mut().zip(disparities) {
            match pixel.replace(disparity) {
                None => frame.came += 1,
                Some(_) => again = true,
            }
        }
        frame.last = Some(place);
        let line = Notice::Line { pixels: frame.came, of: frame.pixels.pixels().len() };
        if again {
            self.tell(Flaw::Again(place));
        }
        (self.notice)(line);
    }

    /// The frame has no end.
    fn break_off(&mut self) {
        self.explain(0..0);
        if let Some(after) = self.frame.as_ref().and_then(|frame| frame.last) {
            self.tell(Flaw::NoEnd { after });
        }
    }

    /// What came, in `bytes` from `path`.
    fn finish(self, stack: Option<u32>, path: &Path, bytes: usize) -> Result<Received> {
        let Some(frame) = self.frame else {
            let found = match self.noise.first() {
                _ if bytes == 0 => "nothing".into(),
                Some(error) => format!("{bytes} bytes without a packet of disparities (at first: {error})"),
                None => format!("{bytes} bytes without a packet of disparities"),
            };
            return Err(Error::format(path, found, "the packets that multiscopic's firmware or `multiscopic simulate` sends"));
        };
        let disparities = frame.pixels.map(|pixel| pixel.flatten());
        Ok(Received { disparities, pixels: frame.came, stack: stack.map(|bytes| bytes as usize) })
    }

    fn tell(&mut self, flaw: Flaw) {
        (self.notice)(Notice::Flaw(flaw));
    }
}

impl Incoming {
    /// A frame of which nothing is there, as a packet from `path` says it is.
    fn new([width, height]: [usize; 2], path: &Path) -> Result<Incoming> {
        let bytes = width as u64 * height as u64 * size_of::<Option<Option<Disparity>>>() as u64;
        input::check_size(path, width as u32, height as u32, bytes)?;
        Ok(Incoming { pixels: Raster::filled(width, height, None), came: 0, last: None })
    }

    fn size(&self) -> [usize; 2] {
        [self.pixels.width(), self.pixels.height()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Params, Region, Views};
    use multiscopic_edge::packet::{Sender, buffer_bytes};

    const PARAMS: Params = match Params::new(3, 4, Views::ALL, Fusion::Min, 1, 4, 3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

    /// The packets of a frame of twos in two tiles, of two columns and one, and of its end.
    fn sent() -> Vec<Vec<u8>> {
        let mut buffer = vec![0; buffer_bytes(3)];
        let mut sender = Sender::new(&PARAMS, &mut buffer);
        let lines = Region::tiles(&PARAMS, 2).flat_map(|tile| (0..4).map(move |v| (tile, v)));
        let two = Disparity::from_bits(128);
        let mut packets: Vec<_> =
            lines.map(|(tile, v)| sender.line(&tile, v, &vec![two; tile.width()]).unwrap().to_vec()).collect();
        packets.push(sender.end(Some(77)).unwrap().to_vec());
        packets
    }

    /// What is received of `packets`, and the words about it.
    fn received(packets: &[Vec<u8>]) -> (Received, Vec<String>, bool) {
        let (mut words, mut harm) = (Vec::new(), false);
        let received = receive(&packets.concat()[..], Path::new("stream"), |notice| {
            if let Notice::Flaw(flaw) = notice {
                words.push(flaw.to_string());
                harm |= flaw.is_harmful();
            }
        });
        (received.unwrap(), words, harm)
    }

    fn refusal(bytes: &[u8]) -> String {
        receive(bytes, Path::new("stream"), |_| ()).unwrap_err().to_string()
    }

    #[test]
    fn tiles_make_a_frame() {
        let (received, words, _) = received(&sent());
        assert_eq!(received.disparities, DisparityMap::filled(3, 4, Disparity::from_bits(128)));
        assert_eq!((received.pixels, received.stack, received.is_complete()), (12, Some(77), true));
        assert_eq!(words, [""; 0]);
    }

    #[test]
    fn what_is_missing_is_named_and_invalid() {
        for (missing, pixels, expected) in [
            (0..1, 10, &["line 0 (packet 0) is lost"][..]),
            (1..3, 8, &["lines 1 to 2 (packets 1 to 2) are lost"]),
            (3..6, 8, &["line 3 (packet 3) is lost", "lines 0 to 1 (packets 4 to 5) are lost"]),
            (7..8, 11, &["line 3 (packet 7) is lost"]),
            (8..9, 12, &["the end of the frame is lost: nothing came after line 3 (packet 7)"]),
        ] {
            let mut packets = sent();
            packets.drain(missing.clone());
            let (received, words, harm) = received(&packets);
            assert_eq!((words, harm, received.pixels), (expected.iter().map(|&word| word.into()).collect(), true, pixels));
            let invalid = received.disparities.pixels().iter().filter(|pixel| pixel.is_none()).count();
            assert_eq!(invalid, 12 - pixels, "without {missing:?}");
        }
    }

    #[test]
    fn a_damaged_packet_is_named() {
        for (i, place) in [(0, "line 0 (packet 0)"), (6, "line 2 (packet 6)")] {
            let mut packets = sent();
            packets[i][12] ^= 0x40;
            let (_, words, harm) = received(&packets);
            assert!(harm && words.len() == 1, "{words:?}");
            assert!(words[0].starts_with(&format!("{place} is damaged: a damaged packet: ")), "{words:?}");
        }
        // One of two that are missing: which one is not known.
        let mut packets = sent();
        packets.remove(2);
        packets[2][12] ^= 0x40;
        let (_, words, _) = received(&packets);
        assert!(words[0].starts_with("after line 1 (packet 1): a damaged packet: "), "{words:?}");
        assert_eq!(words[1..], ["lines 2 to 3 (packets 2 to 3) are lost"]);
    }

    #[test]
    fn a_stream_that_breaks_off_gives_what_came() {
        let mut packets = sent();
        packets.truncate(6);
        packets[5].truncate(9);
        let (received, words, harm) = received(&packets);
        assert_eq!((received.pixels, received.stack, harm), (9, None, true));
        assert!(words[0].starts_with("after line 0 (packet 4): a damaged packet: "), "{words:?}");
        assert_eq!(words[1..], ["the end of the frame is lost: nothing came after line 0 (packet 4)"]);
    }

    #[test]
    fn other_packets_in_between_do_no_harm() {
        let mut packets = sent();
        let other = Params::new(9, 9, Views::ALL, Fusion::Min, 1, 4, 3).unwrap();
        let mut buffer = vec![0; buffer_bytes(9)];
        let line = Sender::new(&other, &mut buffer).line(&Region::whole(&other), 0, &[None; 9]).unwrap().to_vec();
        packets.insert(3, line);
        packets.insert(1, vec![0; 5]);
        let (received, words, harm) = received(&packets);
        assert!(received.is_complete() && !harm);
        assert_eq!(words, ["a foreign packet: of a frame of 9x9 pixels, this one has 3x4"]);
    }

    #[test]
    fn the_next_frame_does_not_mix_in() {
        let mut packets = sent();
        packets.truncate(6);
        packets.extend(sent());
        let (received, words, _) = received(&packets);
        assert_eq!(received.pixels, 10);
        assert_eq!(words, ["the end of the frame is lost: nothing came after line 1 (packet 5)"]);
        // After the end nothing is read.
        let mut packets = sent();
        packets.push(b"noise".to_vec());
        assert_eq!(super::tests::received(&packets).1, [""; 0]);
    }

    #[test]
    fn something_else_is_refused() {
        assert!(refusal(b"").starts_with("stream: found nothing, expected the packets"), "{}", refusal(b""));
        let text = refusal(b"no packets here");
        assert!(text.contains("found 15 bytes without a packet of disparities (at first: a damaged packet"), "{text}");
        let endless = |byte| receive(std::io::BufReader::new(std::io::repeat(byte)), Path::new("stream"), |_| ()).is_err();
        assert!(endless(0) && endless(1) && endless(b'x'));
    }
}
