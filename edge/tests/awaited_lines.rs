//! Lines that are awaited, against the blocking pipeline: the same lines are asked for, and the same bytes are sent.

use std::{cell::RefCell, convert::Infallible, future, iter, task::Poll, time::Duration};

use embassy_futures::block_on;
use embedded_io_async::{ErrorKind, ErrorType, Read};
use multiscopic_core::{
    BlockMatchingParams, ConfidenceLines, ConfidenceTable, Frame, Fusion, MatchError, Matcher, Region, Rewind, ScanlineSource,
    SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, View, Views,
};
use multiscopic_edge::{
    AsyncScanlineSource, AwaitedLineError, AwaitedLines, Board, Matching, Phase, Pipeline, Streams, StreamsError, WholeLines,
    packet::Sender,
};

const WIDTH: usize = 40;
const HEIGHT: usize = 24;

/// Noise at a disparity of 3, and noise of each frame's own.
fn pixels(frame: Frame) -> Vec<u8> {
    let (shift_u, shift_v) = if let Frame::View(view) = frame { view.shift(3) } else { (0, 0) };
    let noise = |u: i32, v: i32, seed: i32| (u * 7919 + v * 104_729 + seed).wrapping_mul(0x2545_f491).unsigned_abs() >> 16;
    let own = i32::from(frame != Frame::Center) + 3 * shift_u + 5 * shift_v;
    let pixel = |u, v| (noise(u - shift_u, v - shift_v, 0) % 200 + noise(u, v, own) % 40) as u8;
    (0..HEIGHT as i32).flat_map(|v| (0..WIDTH as i32).map(move |u| pixel(u, v))).collect()
}

/// Frames in memory.
#[derive(Default)]
struct Stored {
    requests: Vec<(Frame, usize)>,
}

impl ScanlineSource for Stored {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        self.requests.push((frame, v));
        line.copy_from_slice(&pixels(frame)[v * WIDTH..][..WIDTH]);
        Ok(())
    }
}

impl Rewind for Stored {
    fn rewind(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// The bytes that were sent.
#[derive(Default)]
struct Sent(Vec<u8>);

impl ErrorType for Sent {
    type Error = Infallible;
}

impl embedded_io::Write for Sent {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

struct Memory;

impl Board for Memory {
    type Frames = Stored;
    type Output = Sent;
    type Error = Infallible;

    fn frames(&mut self, _: &SearchSpace) -> Result<Stored, Infallible> {
        Ok(Stored::default())
    }

    fn output(&mut self) -> Result<Sent, Infallible> {
        Ok(Sent::default())
    }

    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }

    fn enter(_: Phase) {}
}

/// The packets that the blocking pipeline sends, and the lines that it asks for.
fn blocking(matching: &Matching) -> (Vec<u8>, Vec<(Frame, usize)>) {
    let lengths = matching.lengths();
    let (mut words, mut line, mut packet) = (vec![0; lengths.words()], vec![None; lengths.columns], vec![0; lengths.packet]);
    let (mut frames, mut sent) = ([Stored::default()], Sent::default());
    let pipeline = Pipeline::new(&mut words, &mut line, &mut packet);
    let mut sender = pipeline.run::<Memory, _>(matching, &mut frames, &mut sent).unwrap();
    let end = sender.end(None).unwrap().to_vec();
    let [frames] = frames;
    ([sent.0, end].concat(), frames.requests)
}

/// A port that makes its reader wait, gives a few bytes at a time, and fails now and then.
struct Port {
    bytes: Vec<u8>,
    taken: usize,
    calls: usize,
    fails: bool,
}

impl Port {
    fn new(frame: Frame, fails: bool) -> Port {
        Port { bytes: pixels(frame), taken: 0, calls: 0, fails }
    }
}

impl ErrorType for Port {
    type Error = ErrorKind;
}

impl Read for Port {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        for _ in 0..self.calls % 3 {
            pending_once().await;
        }
        self.calls += 1;
        // Before the first byte of a line, since those before an error are gone.
        if self.fails && self.taken.is_multiple_of(WIDTH) && self.calls.is_multiple_of(2) {
            return Err(ErrorKind::TimedOut);
        }
        let len = buffer.len().min(1 + self.calls % 17);
        buffer[..len].copy_from_slice(&self.bytes[self.taken..][..len]);
        self.taken += len;
        Ok(len)
    }
}

async fn pending_once() {
    let mut polls = 0..2;
    future::poll_fn(|context| {
        context.waker().wake_by_ref();
        polls.next();
        if polls.is_empty() { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
}

/// The frames of [`Stored`] from ports.
struct Ports<'r> {
    streams: Streams<Port>,
    /// The lines that arrived.
    received: &'r RefCell<Vec<(Frame, usize)>>,
}

impl Ports<'_> {
    fn new(views: Views, fails: bool, received: &RefCell<Vec<(Frame, usize)>>) -> Ports<'_> {
        let streams = Streams::open(views, |frame| Ok::<_, Infallible>(Port::new(frame, fails))).unwrap();
        Ports { streams, received }
    }
}

impl AsyncScanlineSource for Ports<'_> {
    type Error = StreamsError<ErrorKind>;

    async fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        self.streams.read_line(frame, v, line).await?;
        self.received.borrow_mut().push((frame, v));
        Ok(())
    }
}

type AwaitError = MatchError<AwaitedLineError<StreamsError<ErrorKind>>>;

/// The result of the first call that does not fail, and the number of those that did.
fn repeated<T>(failures: &mut usize, mut call: impl AsyncFnMut() -> Result<T, AwaitError>) -> T {
    iter::repeat_with(|| block_on(call()))
        .find_map(|result| {
            let timed_out = |error| matches!(error, StreamsError::Read { error: ErrorKind::TimedOut, .. });
            *failures += usize::from(result.is_err());
            result.map_err(|error| assert!(matches!(error, MatchError::Source(AwaitedLineError::Read(e)) if timed_out(e)))).ok()
        })
        .unwrap()
}

/// The packets that are sent if the lines are awaited, those lines in their order, and the number of calls that failed.
fn awaited(matching: &Matching, fails: bool) -> (Vec<u8>, Vec<(Frame, usize)>, usize) {
    let (received, mut held, mut failures) = (RefCell::default(), [0; WIDTH], 0);
    let mut lines = AwaitedLines::new(Ports::new(matching.views(), fails, &received), &mut held);
    let search = matching.search();
    let mut packet = vec![0; matching.lengths().packet];
    let (mut sender, mut sent) = (Sender::new(search, &mut packet), Vec::<u8>::new());
    let (mut words, region) = (vec![0; matching.lengths().matcher.words()], Region::whole(search));
    let (mut line, mut confidences) = ([None; WIDTH], [0; WIDTH]);
    match matching {
        Matching::Blocks { params, .. } => {
            let mut matcher = Matcher::new(params, &mut words).unwrap();
            while let Some(v) =
                repeated(&mut failures, async || lines.bring_to(|lines| matcher.next_line(lines, &mut line)).await)
            {
                sent.extend(sender.line(&region, v, &line).unwrap());
            }
        }
        Matching::SemiGlobal(params) => {
            let mut matcher = SemiGlobalMatcher::new(params, &mut words).unwrap();
            while let Some(v) =
                repeated(&mut failures, async || lines.bring_to(|lines| matcher.next_line(lines, &mut line)).await)
            {
                sent.extend(sender.line(&region, v, &line).unwrap());
            }
        }
        Matching::WithConfidences(WholeLines::Blocks(params)) => {
            let mut matcher = Matcher::new(params, &mut words).unwrap();
            let mut memory = vec![0; ConfidenceLines::memory_words(WIDTH)];
            let mut computed = ConfidenceLines::new(search, &ConfidenceTable::BLOCK_MATCHING, &mut memory).unwrap();
            let mut next = async || {
                let next = |lines: &mut _| {
                    computed.next_line(|out, peaks| matcher.next_line_and_peaks(lines, out, peaks), &mut line, &mut confidences)
                };
                let v = lines.bring_to(next).await?;
                Ok(v.map(|v| sender.line_with_confidences(&region, v, &line, &confidences).unwrap().to_vec()))
            };
            while let Some(packet) = repeated(&mut failures, &mut next) {
                sent.extend(packet);
            }
        }
        _ => unreachable!("no other is tested"),
    }
    sent.extend(sender.end(None).unwrap());
    drop(lines);
    (sent, received.into_inner(), failures)
}

fn matchings() -> Vec<Matching> {
    let config = |views, min_disparity| SearchConfig {
        views,
        fusion: Fusion::Min,
        min_disparity,
        num_disparities: 8,
        ..SearchConfig::of_size(WIDTH as u16, HEIGHT as u16)
    };
    let blocks = |views, min| -> BlockMatchingParams { config(views, min).block_matching(5).unwrap() };
    let whole = |params| Matching::Blocks { params, tile_width: WIDTH };
    let semi_global = |views| {
        let params = SemiGlobalParams::new(config(views, 0).checked().unwrap(), SemiGlobalCost::Sad { block_size: 3 });
        Matching::SemiGlobal(params.unwrap())
    };
    vec![
        whole(blocks(Views::STEREO, 0)),
        whole(blocks(Views::HORIZONTAL, -2)),
        whole(blocks(Views::CROSS, 0)),
        whole(blocks(Views::NONE.with(View::TOP), 1)),
        semi_global(Views::HORIZONTAL),
        semi_global(Views::CROSS),
        Matching::WithConfidences(WholeLines::Blocks(blocks(Views::CROSS, 0))),
    ]
}

#[test]
fn awaited_lines_give_the_bytes_of_the_blocking_pipeline() {
    for matching in matchings() {
        let (sent, requests) = blocking(&matching);
        assert_eq!(awaited(&matching, false), (sent, requests, 0), "{matching:?}");
    }
}

#[test]
fn after_a_failure_the_same_call_goes_on() {
    for matching in matchings() {
        let (sent, requests) = blocking(&matching);
        let (sent_with_failures, received, failures) = awaited(&matching, true);
        assert_eq!((sent_with_failures, received), (sent, requests), "{matching:?}");
        assert!(failures > HEIGHT / 2, "{failures} failures");
    }
}

#[test]
fn lines_have_the_width_of_the_frame() {
    let [Matching::Blocks { params, .. }, ..] = matchings()[..] else { panic!("the first matches blocks") };
    let (received, mut held, mut words) = (RefCell::default(), [0; WIDTH - 1], vec![0; params.memory_words()]);
    let mut lines = AwaitedLines::new(Ports::new(params.views(), false, &received), &mut held);
    let mut matcher = Matcher::new(&params, &mut words).unwrap();
    let end = block_on(lines.bring_to(|lines| matcher.next_line(lines, &mut [None; WIDTH])));
    assert_eq!(end, Err(MatchError::Source(AwaitedLineError::Width { needed: WIDTH, given: WIDTH - 1 })));
}
