//! Assembling a frame from its packets, and reports of it: flaws of packets, and the frame that is received.

use std::{fmt, mem, ops::Range, path::Path};

use multiscopic_core::Disparity;
use multiscopic_edge::packet::{Content, Lost, Packet, PacketError, Receiver};

use crate::{
    error::{Error, Result},
    files::Limits,
    images::{DisparityMap, Raster},
};

/// The kind of a piece of the stream.
pub(super) enum Piece {
    /// Not a packet of this frame.
    Noise,
    /// A line of disparities.
    Line,
    /// The end of the frame.
    End,
    /// The beginning of the next frame.
    NextFrame,
}

/// Assembles a frame, and reports what happens to `notify`.
///
/// A reception may begin in the middle of a frame. That frame is set aside, and taken if no better one follows.
pub(super) struct Assembler<'p, N> {
    receiver: Receiver,
    frame: Option<PartialFrame>,
    /// The frame that was set aside.
    late: Option<PartialFrame>,
    /// The reasons why the pieces since the last packet were not packets of disparities.
    noise: Vec<PacketError>,
    /// The name of the stream in messages.
    path: &'p Path,
    limits: Limits,
    notify: N,
}

/// The part of a frame that has arrived. A packet may claim any size, so memory is taken line by line.
struct PartialFrame {
    /// Width and height.
    size: [usize; 2],
    lines: Vec<PartialLine>,
    received: usize,
    /// The sequence number of the first packet that arrived.
    first_sequence: u32,
    last_packet: Option<PacketId>,
    stack: Option<u32>,
    /// Flaws that are reported if the frame is taken.
    flaws: Vec<Flaw>,
}

/// The part of a line that has arrived. Both are empty until a packet has some.
#[derive(Clone, Default)]
struct PartialLine {
    /// `None` if the pixel has not arrived, `Some(None)` if it is invalid.
    pixels: Vec<Option<Option<Disparity>>>,
    confidences: Vec<u8>,
}

/// A frame may have this many times the pixels that arrived. A single line is enough of any frame with fewer lines than that.
const MAX_EXPANSION: usize = 4096;

impl<'p, N: FnMut(Notice)> Assembler<'p, N> {
    pub(super) fn new(path: &'p Path, limits: Limits, notify: N) -> Assembler<'p, N> {
        Assembler { receiver: Receiver::default(), frame: None, late: None, noise: Vec::new(), path, limits, notify }
    }

    /// Processes the bytes between two zeros of the stream.
    ///
    /// # Errors
    /// The frame is too large for this machine.
    pub(super) fn process(&mut self, piece: &mut [u8]) -> Result<Piece> {
        if piece.is_empty() {
            return Ok(Piece::Noise);
        }
        let decoded = Packet::decode(piece).and_then(|packet| match packet.header {
            // Even tiles of one column make only one packet per pixel, and the end.
            header if u64::from(header.sequence) > u64::from(header.width) * u64::from(header.height) => {
                Err(PacketError::Outside { header })
            }
            _ => Ok(packet),
        });
        let packet = match decoded {
            Ok(packet) => packet,
            Err(error) => {
                self.noise.push(error);
                return Ok(Piece::Noise);
            }
        };
        match self.take(&packet)? {
            Piece::NextFrame if self.set_aside() => self.take(&packet),
            Piece::End if self.set_aside() => Ok(Piece::Line),
            piece => Ok(piece),
        }
    }

    /// Takes a packet of a frame.
    fn take(&mut self, packet: &Packet<'_>) -> Result<Piece> {
        let (size, sequence) = ([packet.header.width, packet.header.height].map(usize::from), packet.header.sequence);
        let frame = match &mut self.frame {
            Some(frame) => frame,
            None => self.frame.insert(PartialFrame::new(size, sequence, self.path, self.limits)?),
        };
        let expected = frame.size;
        if size != expected {
            self.report(Flaw::OtherFrame { found: size, expected });
            return Ok(Piece::Noise);
        }
        match self.receiver.accept(&packet.header) {
            Ok(()) => self.report_missing(0..0),
            Err(Lost { expected, found }) if found < expected => {
                self.report_no_end();
                return Ok(Piece::NextFrame);
            }
            Err(Lost { expected, found }) => self.report_missing(expected..found),
        }
        match packet.header.content {
            Content::Line { line, left, .. } | Content::LineWithConfidences { line, left, .. } => {
                self.store(PacketId { line: line.into(), sequence }, left.into(), packet);
                Ok(Piece::Line)
            }
            Content::End { stack } => {
                self.frame.iter_mut().for_each(|frame| frame.stack = stack);
                Ok(Piece::End)
            }
        }
    }

    /// Sets the frame aside if the reception began in the middle of it, and returns true if so.
    fn set_aside(&mut self) -> bool {
        if !self.is_late() {
            return false;
        }
        self.late = self.frame.take();
        self.receiver = Receiver::default();
        (self.notify)(Notice::Late);
        true
    }

    /// Returns true if the reception began in the middle of the frame.
    fn is_late(&self) -> bool {
        self.late.is_none() && self.frame.as_ref().is_some_and(|frame| frame.first_sequence > 0)
    }

    /// Reports the `missing` packets and the noise before the packet that has just arrived.
    fn report_missing(&mut self, missing: Range<u32>) {
        let Some(frame) = &self.frame else { return };
        let (after, height) = (frame.last_packet, frame.size[1] as u32);
        let noise = mem::take(&mut self.noise);
        let is_damaged = |error: &PacketError| matches!(error, PacketError::Framing | PacketError::Damaged { .. });
        // If as many packets are missing as are damaged, they are the same.
        let are_identified = noise.iter().filter(|error| is_damaged(error)).count() == missing.len();
        let mut damaged_packets =
            missing.clone().map(|sequence| PacketId::of_sequence(sequence, height)).filter(|_| are_identified);
        for error in noise {
            self.report(match is_damaged(&error) {
                true => Flaw::Damaged { packet: damaged_packets.next(), after, error },
                false => Flaw::Foreign { after, error },
            });
        }
        // One report per tile, so that line numbers are consecutive.
        let mut lost = if are_identified { 0..0 } else { missing };
        while !lost.is_empty() {
            let end = (lost.start / height + 1).saturating_mul(height).min(lost.end);
            let [first, last] = [lost.start, end - 1].map(|sequence| PacketId::of_sequence(sequence, height));
            self.report(Flaw::Lost { first, last });
            lost.start = end;
        }
    }

    /// Stores the disparities of a packet, whose first is in column `left`, and their confidences.
    fn store(&mut self, id: PacketId, left: usize, packet: &Packet<'_>) {
        let Some(frame) = &mut self.frame else { return };
        let ([width, height], mut is_repeated) = (frame.size, false);
        let line = &mut frame.lines[id.line as usize];
        line.pixels.resize(width, None);
        for (pixel, disparity) in line.pixels[left..].iter_mut().zip(packet.disparities()) {
            match pixel.replace(disparity) {
                None => frame.received += 1,
                Some(_) => is_repeated = true,
            }
        }
        if let confidences @ [_, ..] = packet.confidences() {
            line.confidences.resize(width, 0);
            line.confidences[left..left + confidences.len()].copy_from_slice(confidences);
        }
        frame.last_packet = Some(id);
        let line = Notice::Line { pixels: frame.received, of: width * height };
        if is_repeated {
            self.report(Flaw::Repeated(id));
        }
        (self.notify)(line);
    }

    /// Reports that the frame has no end.
    pub(super) fn report_no_end(&mut self) {
        self.report_missing(0..0);
        if let Some(after) = self.frame.as_ref().and_then(|frame| frame.last_packet) {
            self.report(Flaw::NoEnd { after });
        }
    }

    /// Returns the frame, after `bytes` bytes of the stream, or the one that was set aside if more of that arrived.
    ///
    /// # Errors
    /// The stream had no packets of disparities, or hardly any of a large frame.
    pub(super) fn finish(mut self, bytes: usize) -> Result<ReceivedFrame> {
        let frames = [self.late, self.frame].into_iter().flatten();
        let Some(mut frame) = frames.max_by_key(|frame| frame.received) else {
            let found = match self.noise.first() {
                _ if bytes == 0 => "nothing".into(),
                Some(error) => format!("{bytes} bytes without a packet of disparities (the first error: {error})"),
                None => format!("{bytes} bytes without a packet of disparities"),
            };
            let expected = "the packets that multiscopic's firmware or `multiscopic simulate` sends";
            return Err(Error::format(self.path, found, expected));
        };
        mem::take(&mut frame.flaws).into_iter().for_each(|flaw| (self.notify)(Notice::Flaw(flaw)));
        let ([width, height], pixels) = (frame.size, frame.received);
        let enough = (width * height).div_ceil(MAX_EXPANSION);
        if pixels < enough {
            let found = format!("{pixels} pixels of a frame of {width}x{height}");
            return Err(Error::format(self.path, found, format!("at least {enough} of them: it is damaged, or another stream")));
        }
        let stack = frame.stack.map(|bytes| bytes as usize);
        let (disparities, confidences) = frame.maps();
        Ok(ReceivedFrame { disparities, confidences, pixels, stack })
    }

    /// Reports a flaw of the frame: at once, or when the frame is taken if it may be set aside.
    fn report(&mut self, flaw: Flaw) {
        let is_late = self.is_late() || self.late.is_some();
        match &mut self.frame {
            Some(frame) if is_late => frame.flaws.push(flaw),
            _ => (self.notify)(Notice::Flaw(flaw)),
        }
    }
}

impl PartialFrame {
    /// An empty frame. The size is what its first packet from `path` says, which has this sequence number.
    fn new([width, height]: [usize; 2], first_sequence: u32, path: &Path, limits: Limits) -> Result<PartialFrame> {
        limits.check_size(path, width as u32, height as u32)?;
        let lines = vec![PartialLine::default(); height];
        let (last_packet, stack, flaws) = (None, None, Vec::new());
        Ok(PartialFrame { size: [width, height], lines, received: 0, first_sequence, last_packet, stack, flaws })
    }

    /// The disparities, and the confidences if a packet had some.
    fn maps(self) -> (DisparityMap, Option<Raster<u8>>) {
        let [width, height] = self.size;
        let has_confidences = self.lines.iter().any(|line| !line.confidences.is_empty());
        let mut confidences = has_confidences.then(|| Raster::filled(width, height, 0));
        let mut disparities = Raster::filled(width, height, None);
        // Lines give their memory back as they are copied.
        for (v, line) in self.lines.into_iter().enumerate() {
            for (disparity, pixel) in disparities.row_mut(v).iter_mut().zip(line.pixels) {
                *disparity = pixel.flatten();
            }
            if let (Some(confidences), [_, ..]) = (&mut confidences, &line.confidences[..]) {
                confidences.row_mut(v).copy_from_slice(&line.confidences);
            }
        }
        (disparities, confidences)
    }
}

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
    /// The reception began in the middle of a frame, which has ended. The next one is waited for.
    Late,
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
            Flaw::Lost { first, last } => {
                match first == last {
                    true => write!(f, "{first} is lost"),
                    false => {
                        write!(
                            f,
                            "lines {} to {} (packets {} to {}) are lost",
                            first.line, last.line, first.sequence, last.sequence
                        )
                    }
                }?;
                f.write_str(if first.sequence == 0 { ", or sent before the reception began" } else { "" })
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
