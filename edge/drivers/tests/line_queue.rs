//! The queue of lines between the interrupt and the program: in every order of their steps, and with both at work at once.

use std::{
    collections::VecDeque,
    sync::atomic::{AtomicU32, Ordering},
    thread,
    time::{Duration, Instant},
};

use multiscopic_drivers::hm01b0::{Arrival, LineQueue, LineReceiver, LineSender, PixelBus};

const PIXELS: usize = 32;
/// The number of buffers, and the parameter of a queue for them.
const BUFFERS: usize = 2;
const N: usize = BUFFERS + 2;

/// The pixels of a line, which repeat its frame and its number.
fn pixels(frame: u32, number: usize) -> [u8; PIXELS] {
    let word = (u64::from(frame) << 8 | number as u64).to_le_bytes();
    std::array::from_fn(|u| word[u % word.len()])
}

/// The frame and the number that these pixels repeat.
fn origin(line: &[u8]) -> (u32, usize) {
    let word = u64::from_le_bytes(*line.first_chunk().expect("a word"));
    let (frame, number) = ((word >> 8) as u32, word as usize & 0xff);
    assert_eq!(line, pixels(frame, number), "a line is mixed with another");
    (frame, number)
}

/// A step of the interrupt.
#[derive(Clone, Copy, Debug)]
enum Send {
    BeginFrame,
    FillLine,
    EndLine,
    EndFrame,
}

/// A step of the program.
#[derive(Clone, Copy, Debug)]
enum Receive {
    Restart,
    Next,
}

/// A line with the address of its buffer, or the end of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sent {
    Line { frame: u32, number: usize, buffer: *const u8 },
    End { lines: usize },
}

/// The queue's definition.
#[derive(Default)]
struct Model {
    /// Sent and not yet taken, each with the number of restarts before its frame began.
    queued: VecDeque<(usize, Sent)>,
    restarts: usize,
    /// The number of restarts before the current frame began.
    began: usize,
    frame: u32,
    number: usize,
    /// The buffers that the interrupt is filling and that the program is reading.
    filled: Option<*const u8>,
    read: Option<*const u8>,
}

impl Model {
    /// The next thing that the program receives: nothing of a frame that began before its last restart.
    fn next(&mut self) -> Option<Sent> {
        self.read = None;
        while let Some((restarts, sent)) = self.queued.pop_front() {
            if restarts == self.restarts {
                if let Sent::Line { buffer, .. } = sent {
                    self.read = Some(buffer);
                }
                return Some(sent);
            }
        }
        None
    }

    /// The buffers that the interrupt must not write to.
    fn taken(&self) -> Vec<*const u8> {
        let queued = self.queued.iter().filter_map(|(_, sent)| match sent {
            Sent::Line { buffer, .. } => Some(*buffer),
            Sent::End { .. } => None,
        });
        queued.chain(self.read).collect()
    }
}

/// Takes a step of the interrupt, in the queue and in the model.
fn send(step: Send, sender: &mut LineSender<'_, '_>, model: &mut Model) {
    match step {
        Send::BeginFrame => {
            sender.begin_frame();
            (model.frame, model.number, model.began) = (model.frame + 1, 0, model.restarts);
        }
        Send::FillLine => {
            let (buffer, taken) = (sender.buffer(), model.taken());
            assert_eq!(buffer.is_some(), taken.len() < BUFFERS, "{} buffers are taken", taken.len());
            if let Some(buffer) = buffer {
                assert!(!taken.contains(&buffer.as_ptr()), "a buffer is in two hands");
                buffer.copy_from_slice(&pixels(model.frame, model.number));
                model.filled = Some(buffer.as_ptr());
            }
        }
        Send::EndLine => {
            sender.end_line(PIXELS);
            if let Some(buffer) = model.filled.take() {
                let line = Sent::Line { frame: model.frame, number: model.number, buffer };
                model.queued.push_back((model.began, line));
            }
            model.number += 1;
        }
        Send::EndFrame => {
            sender.end_frame();
            // Besides all buffers, there is room for one end.
            if model.queued.len() <= BUFFERS {
                model.queued.push_back((model.began, Sent::End { lines: model.number }));
            }
        }
    }
}

/// Takes a step of the program, in the queue and in the model, and compares what they return.
fn receive(step: Receive, receiver: &mut LineReceiver<'_, '_>, model: &mut Model) -> Option<Sent> {
    match step {
        Receive::Restart => {
            receiver.restart();
            model.restarts += 1;
            None
        }
        Receive::Next => {
            let next = receiver.next().map(|arrival| match arrival {
                Arrival::Line { number, pixels, .. } => {
                    let (frame, filled) = origin(pixels);
                    assert_eq!(filled, number);
                    Sent::Line { frame, number, buffer: pixels.as_ptr() }
                }
                Arrival::End { lines } => Sent::End { lines },
            });
            assert_eq!(next, model.next());
            next
        }
    }
}

/// Asserts that no buffer was lost: after a restart, all of them take a line.
fn assert_all_buffers_return(sender: &mut LineSender<'_, '_>, receiver: &mut LineReceiver<'_, '_>) {
    receiver.restart();
    while receiver.next().is_some() {}
    sender.begin_frame();
    for number in 0..BUFFERS {
        sender.buffer().expect("no buffer was lost").copy_from_slice(&pixels(1, number));
        sender.end_line(PIXELS);
    }
    assert_eq!(sender.buffer(), None);
    for number in 0..BUFFERS {
        assert_eq!(receiver.next(), Some(Arrival::Line { number, pixels: &pixels(1, number), sent: PIXELS }));
    }
    assert_eq!(receiver.next(), None);
}

/// Takes the steps in an order that has a bit for each, which is 1 for the program's. Returns what arrived.
fn run(order: u32, sending: &[Send], receiving: &[Receive]) -> Vec<Sent> {
    let (mut memory, mut queue) = ([[0; PIXELS]; BUFFERS], LineQueue::<N>::new());
    let (mut sender, mut receiver) = queue.split(memory.iter_mut().map(|buffer| &mut buffer[..]));
    let (mut model, mut arrived) = (Model::default(), Vec::new());
    let (mut send_steps, mut receive_steps) = (sending.iter(), receiving.iter());
    for bit in 0..sending.len() + receiving.len() {
        if order >> bit & 1 == 0 {
            send(*send_steps.next().expect("a step"), &mut sender, &mut model);
        } else {
            arrived.extend(receive(*receive_steps.next().expect("a step"), &mut receiver, &mut model));
        }
    }
    assert_all_buffers_return(&mut sender, &mut receiver);
    arrived
}

/// The interrupt's steps of a frame of `lines` lines.
fn frame(lines: usize) -> Vec<Send> {
    [&[Send::BeginFrame][..], &[Send::FillLine, Send::EndLine].repeat(lines), &[Send::EndFrame]].concat()
}

/// Two frames, while the program restarts, receives, restarts and receives.
#[test]
fn all_orders_of_steps_do_what_the_model_does() {
    // With three lines, the interrupt runs out of buffers.
    for (lines, receptions) in [([2, 2], [3, 3]), ([3, 2], [2, 3])] {
        let sending = lines.map(frame).concat();
        let receiving = receptions.map(|count| [&[Receive::Restart][..], &[Receive::Next].repeat(count)].concat()).concat();
        let orders = 0..1_u32 << (sending.len() + receiving.len());
        let orders = orders.filter(|order| order.count_ones() as usize == receiving.len());
        let arrived: Vec<_> = orders.map(|order| run(order, &sending, &receiving)).collect();
        assert!(arrived.len() > 100_000);
        // In some orders nothing arrives, in others each reception is one.
        let most = arrived.iter().map(Vec::len).max();
        assert!(arrived.iter().any(Vec::is_empty) && most == Some(receptions.iter().sum()), "{most:?}");
    }
}

/// An interrupt that sends frames without a pause, and a program that restarts at any moment.
#[test]
fn both_sides_work_at_once() {
    const LINES: usize = 5;
    let (mut memory, mut queue) = ([[0; PIXELS]; BUFFERS], LineQueue::<N>::new());
    let (mut sender, mut receiver) = queue.split(memory.iter_mut().map(|buffer| &mut buffer[..]));
    // The number of the last frame that has begun.
    let begun = AtomicU32::new(0);
    let start = Instant::now();
    thread::scope(|scope| {
        let program = scope.spawn(|| {
            let ([mut lines, mut ends], mut random) = ([0; 2], 1_u32);
            // On a busy system, it takes longer until enough has arrived.
            while start.elapsed() < Duration::from_secs(1) || lines < 500 || ends < 50 {
                let before = begun.load(Ordering::Acquire);
                receiver.restart();
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let mut polls = random >> 28;
                let mut last = (before, usize::MAX);
                // At least one line arrives: after 256 restarts during one frame, the queue would take it for a new one.
                while polls > 0 || last.1 == usize::MAX {
                    match receiver.next() {
                        Some(Arrival::Line { number, pixels, .. }) => {
                            let (frame, filled) = origin(pixels);
                            assert!((frame, filled) > last, "line {filled} of frame {frame} after {last:?}");
                            assert_eq!(filled, number);
                            last = (frame, number);
                            lines += 1;
                        }
                        Some(Arrival::End { lines }) => {
                            assert_eq!(lines, LINES);
                            ends += 1;
                        }
                        None => thread::yield_now(),
                    }
                    assert!(start.elapsed() < Duration::from_secs(30), "nothing arrives");
                    polls = polls.saturating_sub(1);
                }
            }
        });
        while !program.is_finished() {
            sender.begin_frame();
            let frame = begun.load(Ordering::Relaxed) + 1;
            begun.store(frame, Ordering::Release);
            for number in 0..LINES {
                match sender.buffer() {
                    Some(buffer) => buffer.copy_from_slice(&pixels(frame, number)),
                    // Both may share a processor.
                    None => thread::yield_now(),
                }
                sender.end_line(PIXELS);
            }
            sender.end_frame();
        }
    });
    assert_all_buffers_return(&mut sender, &mut receiver);
}
