//! Lines on their way from an interrupt to the program.

use core::sync::atomic::{AtomicU8, Ordering};
use heapless::spsc::{Consumer, Producer, Queue};

use super::pixel_bus::{Arrival, PixelBus};

/// Two queues: lines that are full go to the program, buffers that are empty come back. Nothing is copied, and no side waits for
/// the other.
///
/// `N` is the number of buffers and two more, for the ends of frames.
///
/// ```
/// use multiscopic_edge::hm01b0::{Arrival, LineQueue, PixelBus};
///
/// // Statics in firmware.
/// let mut buffers = [[0; 324]; 6];
/// let mut queue = LineQueue::<8>::new();
/// let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
///
/// // The program.
/// receiver.restart();
/// // The interrupt, as a frame begins, as a line comes (or the DMA has filled it), and as the frame ends.
/// sender.begin_frame();
/// if let Some(buffer) = sender.buffer() {
///     buffer.fill(7);
/// }
/// sender.end_line(324);
/// sender.end_frame();
/// // The program again.
/// assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[7; 324] }));
/// assert_eq!(receiver.next(), Some(Arrival::End { lines: 1 }));
/// assert_eq!(receiver.next(), None);
/// ```
#[derive(Debug)]
pub struct LineQueue<'b, const N: usize> {
    full: Queue<Parcel<'b>, N>,
    empty: Queue<&'b mut [u8], N>,
    /// The frame that the program wants.
    wanted: AtomicU8,
}

/// What is sent.
#[derive(Debug)]
enum Parcel<'b> {
    Line { frame: u8, number: usize, pixels: usize, buffer: &'b mut [u8] },
    End { frame: u8, lines: usize },
}

impl<'b, const N: usize> LineQueue<'b, N> {
    /// Empty queues.
    #[expect(clippy::new_without_default, reason = "a static is initialised with it")]
    pub const fn new() -> Self {
        LineQueue { full: Queue::new(), empty: Queue::new(), wanted: AtomicU8::new(0) }
    }

    /// The ends of the queues, with `N - 2` of the buffers, each for a line, or as many as there are.
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
            // There is room for them all.
            let _ = returned.enqueue(buffer);
        }
        let wanted = &self.wanted;
        let sender = LineSender { full, empty, wanted, frame, number: 0, buffer: None };
        (sender, LineReceiver { full: received, empty: returned, wanted, frame, held: None })
    }
}

/// The interrupt's end.
pub struct LineSender<'q, 'b> {
    full: Producer<'q, Parcel<'b>>,
    empty: Consumer<'q, &'b mut [u8]>,
    wanted: &'q AtomicU8,
    /// The frame that the lines are of, and the number of the next one.
    frame: u8,
    number: usize,
    buffer: Option<&'b mut [u8]>,
}

impl LineSender<'_, '_> {
    /// A frame begins.
    pub fn begin_frame(&mut self) {
        self.frame = self.wanted.load(Ordering::Acquire);
        self.number = 0;
    }

    /// Where the next line goes; none if the program is behind with the lines before: then the line is lost.
    pub fn buffer(&mut self) -> Option<&mut [u8]> {
        if self.buffer.is_none() {
            self.buffer = self.empty.dequeue();
        }
        self.buffer.as_deref_mut()
    }

    /// A line has ended after so many pixels, which are in the buffer, if there was one.
    pub fn end_line(&mut self, pixels: usize) {
        if let Some(buffer) = self.buffer.take() {
            let line = Parcel::Line { frame: self.frame, number: self.number, pixels, buffer };
            if let Err(Parcel::Line { buffer, .. }) = self.full.enqueue(line) {
                self.buffer = Some(buffer);
            }
        }
        self.number += 1;
    }

    /// The frame has ended.
    pub fn end_frame(&mut self) {
        // If there is no room for it, the program has not asked for lines for a long time, and waits for the end in vain.
        let _ = self.full.enqueue(Parcel::End { frame: self.frame, lines: self.number });
    }
}

/// The program's end.
pub struct LineReceiver<'q, 'b> {
    full: Consumer<'q, Parcel<'b>>,
    empty: Producer<'q, &'b mut [u8]>,
    wanted: &'q AtomicU8,
    frame: u8,
    /// The buffer of the line that was asked for last.
    held: Option<&'b mut [u8]>,
}

impl LineReceiver<'_, '_> {
    fn give_back(&mut self) {
        if let Some(buffer) = self.held.take() {
            // There is room for them all.
            let _ = self.empty.enqueue(buffer);
        }
    }
}

impl PixelBus for LineReceiver<'_, '_> {
    fn restart(&mut self) {
        // There are never lines of 256 frames on their way.
        self.frame = self.frame.wrapping_add(1);
        self.wanted.store(self.frame, Ordering::Release);
    }

    fn next(&mut self) -> Option<Arrival<'_>> {
        self.give_back();
        loop {
            match self.full.dequeue()? {
                Parcel::Line { frame, number, pixels, buffer } => {
                    let buffer: &mut [u8] = self.held.insert(buffer);
                    if frame == self.frame {
                        let pixels = pixels.min(buffer.len());
                        return Some(Arrival::Line { number, pixels: self.held.as_deref()?.get(..pixels)? });
                    }
                    self.give_back();
                }
                Parcel::End { frame, lines } if frame == self.frame => return Some(Arrival::End { lines }),
                Parcel::End { .. } => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(sender: &mut LineSender<'_, '_>, value: u8) -> bool {
        let has_room = sender.buffer().map(|buffer| buffer.fill(value)).is_some();
        sender.end_line(3);
        has_room
    }

    #[test]
    fn lines_beyond_the_buffers_are_lost_and_numbered() {
        let (mut buffers, mut queue) = ([[0; 3]; 2], LineQueue::<4>::new());
        let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
        for _ in 0..5 {
            receiver.restart();
            sender.begin_frame();
            assert!(send(&mut sender, 1) && send(&mut sender, 2) && !send(&mut sender, 3));
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[1; 3] }));
            assert!(!send(&mut sender, 4), "the line is still looked at");
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 1, pixels: &[2; 3] }));
            assert_eq!(receiver.next(), None);
            assert!(send(&mut sender, 5));
            sender.end_frame();
            assert_eq!(receiver.next(), Some(Arrival::Line { number: 4, pixels: &[5; 3] }));
            assert_eq!(receiver.next(), Some(Arrival::End { lines: 5 }));
        }
    }

    #[test]
    fn what_began_before_a_restart_does_not_come() {
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
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[3; 3] }));
    }

    #[test]
    fn a_line_may_be_shorter_than_its_buffer_and_not_longer() {
        let (mut buffers, mut queue) = ([[0; 3]; 2], LineQueue::<4>::new());
        let (mut sender, mut receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
        receiver.restart();
        sender.begin_frame();
        for pixels in [2, 4] {
            assert!(sender.buffer().is_some());
            sender.end_line(pixels);
        }
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 0, pixels: &[0; 2] }));
        assert_eq!(receiver.next(), Some(Arrival::Line { number: 1, pixels: &[0; 3] }));
    }
}
