//! The lines of the sensor: the bus that they come over, a queue from an interrupt to the program, and the readout of a frame.

use core::sync::atomic::{AtomicU8, Ordering};
use heapless::spsc::{Consumer, Producer, Queue};
use multiscopic_core::Frame;

use super::sensor::Size;

/// Receives the lines of a sensor: from an interrupt, through a [`LineQueue`], or straight from a peripheral that buffers a few.
pub trait PixelBus {
    /// Drops the frame that is being received. The next line begins a frame that started after this call.
    fn restart(&mut self);

    /// The next line or the end of the frame, or nothing if neither has arrived yet. Never blocks.
    fn next(&mut self) -> Option<Arrival<'_>>;
}

/// An event on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival<'a> {
    /// A line.
    Line {
        /// Its number in the frame, from 0. Lost lines count.
        number: usize,
        /// Its pixels, as many as its buffer holds.
        pixels: &'a [u8],
        /// The number of pixels that the sensor sent.
        sent: usize,
    },
    /// The end of the frame.
    End {
        /// The number of its lines. Lost lines count.
        lines: usize,
    },
}

/// A queue of lines from an interrupt to the program.
///
/// Full buffers go one way and empty ones come back, so nothing is copied, and neither side waits for the
/// other.
///
/// `N` is the number of line buffers plus two: one for the end of a frame, and one that the ring buffer
/// leaves empty.
///
/// ```
/// use multiscopic_drivers::hm01b0::{Arrival, LineQueue, PixelBus};
///
/// // Statics in firmware.
/// let mut buffers = [[0; 324]; 6];
/// let mut queue = LineQueue::<8>::new();
/// let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
///
/// // The program.
/// receiver.restart();
/// // The interrupt: at the start of a frame, for each line, and at the end of the frame.
/// sender.begin_frame();
/// if let Some(buffer) = sender.buffer() {
///     buffer.fill(7);
/// }
/// sender.end_line(324);
/// sender.end_frame();
/// // The program again.
/// assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[7; 324], sent: 324 }));
/// assert_eq!(receiver.next(), Some(Arrival::End { lines: 1 }));
/// assert_eq!(receiver.next(), None);
/// ```
#[derive(Debug)]
pub struct LineQueue<'b, const N: usize> {
    full: Queue<Parcel<'b>, N>,
    empty: Queue<&'b mut [u8], N>,
    /// The number of the frame that the program waits for. Lines of earlier frames are dropped.
    wanted: AtomicU8,
}

/// A line or the end of a frame, on its way to the program.
///
/// `frame` is the number of the frame that the program waited for when the frame began.
#[derive(Debug)]
enum Parcel<'b> {
    Line { frame: u8, number: usize, pixels: usize, buffer: &'b mut [u8] },
    End { frame: u8, lines: usize },
}

impl<'b, const N: usize> LineQueue<'b, N> {
    /// An empty queue, to initialise a static with.
    #[expect(clippy::new_without_default, reason = "a static needs a const fn")]
    pub const fn new() -> Self {
        LineQueue { full: Queue::new(), empty: Queue::new(), wanted: AtomicU8::new(0) }
    }

    /// Splits the queue into its two ends. It takes up to `N - 2` of the buffers, each for a line.
    pub fn split<'q>(
        &'q mut self,
        buffers: impl IntoIterator<Item = &'b mut [u8]>,
    ) -> (LineSender<'q, 'b>, LineReceiver<'q, 'b>) {
        while self.full.dequeue().is_some() {}
        while self.empty.dequeue().is_some() {}
        let frame = *self.wanted.get_mut();
        let (full, received) = self.full.split();
        let (mut returned, empty) = self.empty.split();
        for buffer in buffers.into_iter().take(N.saturating_sub(2)) {
            // Cannot fail: a queue holds N - 1.
            let _ = returned.enqueue(buffer);
        }
        let wanted = &self.wanted;
        let sender = LineSender { full, empty, wanted, frame, number: 0, buffer: None };
        (sender, LineReceiver { full: received, empty: returned, wanted, frame, held: None })
    }
}

/// The end of a [`LineQueue`] in the interrupt.
pub struct LineSender<'q, 'b> {
    full: Producer<'q, Parcel<'b>>,
    empty: Consumer<'q, &'b mut [u8]>,
    wanted: &'q AtomicU8,
    /// The frame that the lines belong to.
    frame: u8,
    /// The number of the next line.
    number: usize,
    buffer: Option<&'b mut [u8]>,
}

impl LineSender<'_, '_> {
    /// Notes the start of a frame.
    pub fn begin_frame(&mut self) {
        self.frame = self.wanted.load(Ordering::Acquire);
        self.number = 0;
    }

    /// The buffer for the next line, or nothing if the program holds all buffers. Then the line is lost.
    pub fn buffer(&mut self) -> Option<&mut [u8]> {
        if self.buffer.is_none() {
            self.buffer = self.empty.dequeue();
        }
        self.buffer.as_deref_mut()
    }

    /// Notes the end of a line of `pixels` pixels, and sends the buffer if there was one. The receiver reports a line that is too
    /// short or too long, also one that is longer than its buffer.
    pub fn end_line(&mut self, pixels: usize) {
        if let Some(buffer) = self.buffer.take() {
            let line = Parcel::Line { frame: self.frame, number: self.number, pixels, buffer };
            if let Err(Parcel::Line { buffer, .. }) = self.full.enqueue(line) {
                self.buffer = Some(buffer);
            }
        }
        self.number += 1;
    }

    /// Notes the end of the frame.
    pub fn end_frame(&mut self) {
        // Fails only if the end of an earlier frame is still queued. The program then runs into its time-out.
        let _ = self.full.enqueue(Parcel::End { frame: self.frame, lines: self.number });
    }
}

/// The end of a [`LineQueue`] in the program.
pub struct LineReceiver<'q, 'b> {
    full: Consumer<'q, Parcel<'b>>,
    empty: Producer<'q, &'b mut [u8]>,
    wanted: &'q AtomicU8,
    frame: u8,
    /// The buffer of the line that was returned last.
    held: Option<&'b mut [u8]>,
}

impl LineReceiver<'_, '_> {
    fn return_held(&mut self) {
        if let Some(buffer) = self.held.take() {
            // Cannot fail: a queue holds N - 1.
            let _ = self.empty.enqueue(buffer);
        }
    }
}

impl PixelBus for LineReceiver<'_, '_> {
    fn restart(&mut self) {
        // The number may wrap: lines of 256 frames are never queued at once.
        self.frame = self.frame.wrapping_add(1);
        self.wanted.store(self.frame, Ordering::Release);
    }

    fn next(&mut self) -> Option<Arrival<'_>> {
        self.return_held();
        loop {
            match self.full.dequeue()? {
                Parcel::Line { frame, number, pixels, buffer } => {
                    let buffer: &mut [u8] = self.held.insert(buffer);
                    if frame == self.frame {
                        let held = pixels.min(buffer.len());
                        return Some(Arrival::Line { number, pixels: self.held.as_deref()?.get(..held)?, sent: pixels });
                    }
                    self.return_held();
                }
                Parcel::End { frame, lines } if frame == self.frame => return Some(Arrival::End { lines }),
                Parcel::End { .. } => {}
            }
        }
    }
}

/// A frame that is being read out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Readout {
    pub frame: Frame,
    /// True if the frame is matched during readout instead of being stored.
    pub is_streamed: bool,
    /// The next line of the sensor, border included.
    pub next: usize,
    pub has_ended: bool,
    /// Sticky: a damaged frame stays damaged.
    pub defect: Option<FrameDefect>,
}

/// A line, or the end of a frame, from the sensor.
pub(super) enum SensorOutput<'a> {
    /// A line of the sensor's border.
    Border,
    /// A line of the frame: its number and its pixels, without the border.
    Line(usize, &'a [u8]),
    /// The end of the frame.
    End,
}

/// A fault of a frame. Lines count from the top of the sensor, border included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FrameDefect {
    Lost { line: usize },
    Torn { lines: usize },
    Line { line: usize, pixels: usize },
}

impl Readout {
    /// The readout of `frame`, which has not begun.
    pub fn new(frame: Frame, is_streamed: bool) -> Readout {
        Readout { frame, is_streamed, next: 0, has_ended: false, defect: None }
    }

    /// Takes the next line or the end of the frame from the bus, or nothing if neither has arrived yet.
    ///
    /// # Errors
    /// The line is not the next one of the frame, or not of its width; or the frame ended in the wrong place.
    pub fn receive<'b, B: PixelBus>(&mut self, bus: &'b mut B, size: Size) -> Result<Option<SensorOutput<'b>>, FrameDefect> {
        if let Some(defect) = self.defect {
            return Err(defect);
        }
        if self.has_ended {
            return Ok(Some(SensorOutput::End));
        }
        let defect = match bus.next() {
            None => return Ok(None),
            Some(Arrival::Line { number, .. }) if number != self.next => FrameDefect::Lost { line: self.next },
            Some(Arrival::Line { number, pixels, sent }) if is_whole(pixels, sent, size) && number < size.lines() => {
                self.next += 1;
                let rows = size.border()..size.border() + size.height();
                let line = pixels.get(size.border()..size.border() + size.width());
                return Ok(Some(match line.filter(|_| rows.contains(&number)) {
                    Some(line) => SensorOutput::Line(number - rows.start, line),
                    None => SensorOutput::Border,
                }));
            }
            Some(Arrival::Line { number, sent, .. }) => FrameDefect::Line { line: number, pixels: sent },
            Some(Arrival::End { lines }) if lines != size.lines() => FrameDefect::Torn { lines },
            Some(Arrival::End { lines }) if lines != self.next => FrameDefect::Lost { line: self.next },
            Some(Arrival::End { .. }) => {
                self.has_ended = true;
                return Ok(Some(SensorOutput::End));
            }
        };
        self.defect = Some(defect);
        Err(defect)
    }
}

/// True if a line is as long as the sensor's, and its buffer too.
fn is_whole(pixels: &[u8], sent: usize, size: Size) -> bool {
    [pixels.len(), sent] == [size.columns(); 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(sender: &mut LineSender<'_, '_>, value: u8) -> bool {
        let has_buffer = sender.buffer().map(|buffer| buffer.fill(value)).is_some();
        sender.end_line(3);
        has_buffer
    }

    #[test]
    fn lines_without_a_buffer_are_lost_but_counted() {
        let (mut buffers, mut queue) = ([[0; 3]; 2], LineQueue::<4>::new());
        let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
        for _ in 0..5 {
            receiver.restart();
            sender.begin_frame();
            assert!(send(&mut sender, 1) && send(&mut sender, 2) && !send(&mut sender, 3));
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[1; 3], sent: 3 }));
            assert!(!send(&mut sender, 4), "the program still holds the line");
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 1, pixels: &[2; 3], sent: 3 }));
            assert_eq!(receiver.next(), None);
            assert!(send(&mut sender, 5));
            sender.end_frame();
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 4, pixels: &[5; 3], sent: 3 }));
            assert_eq!(receiver.next(), Some(Arrival::End { lines: 5 }));
        }
    }

    #[test]
    fn frames_that_began_before_a_restart_are_dropped() {
        let (mut buffers, mut queue) = ([[0; 3]; 2], LineQueue::<4>::new());
        let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
        receiver.restart();
        sender.begin_frame();
        assert!(send(&mut sender, 1));
        receiver.restart();
        assert!(send(&mut sender, 2));
        sender.end_frame();
        assert_eq!(receiver.next(), None);
        sender.begin_frame();
        assert!(send(&mut sender, 3));
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[3; 3], sent: 3 }));
    }

    #[test]
    fn a_line_is_cut_to_its_buffer() {
        let (mut buffers, mut queue) = ([[0; 3]; 2], LineQueue::<4>::new());
        let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
        receiver.restart();
        sender.begin_frame();
        for pixels in [2, 4] {
            assert!(sender.buffer().is_some());
            sender.end_line(pixels);
        }
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[0; 2], sent: 2 }));
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 1, pixels: &[0; 3], sent: 4 }));
    }

    #[test]
    fn a_line_longer_than_its_buffer_is_a_defect() {
        for pixels in [161, 162, 163] {
            let (mut buffers, mut queue) = ([[0; 162]; 1], LineQueue::<3>::new());
            let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
            receiver.restart();
            sender.begin_frame();
            assert!(sender.buffer().is_some());
            sender.end_line(pixels);
            let received = Readout::new(Frame::Center, false).receive(&mut receiver, Size::Qqvga).map(|_| ());
            assert_eq!(received, if pixels == 162 { Ok(()) } else { Err(FrameDefect::Line { line: 0, pixels }) });
        }
    }
}
