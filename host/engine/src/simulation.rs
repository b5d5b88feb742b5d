//! The firmware's pipeline on the host: the same parameters, memory, order of lines and packets, with frames in memory.
//!
//! Its vectors have sixteen lanes instead of eight, as those of the engine's fallback, so that they are compiled once. Parts of
//! the workspace then begin at multiples of 32 bytes instead of 16, and it is a little longer than the firmware's.

use std::{convert::Infallible, iter, time::Duration};

use multiscopic_core::{Frame, Fusion, Rewind, ScanlineSource, SearchSpace, SweepOffset, View, Views};
use multiscopic_edge::{Board, Phase, Pipeline, Profile, Streams, StreamsError, SweepPipeline, SweepProfile};

use crate::{planes::Planes, simd::Baseline};

/// The firmware's work on a set of frames: the packets that it sends, and the lines and the memory that it takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// The packets that it sends, byte for byte, except that the last one does not tell the depth of the
    /// stack: only the processor can measure it.
    pub packets: Vec<u8>,
    /// Passes over the frames, one for each column tile; of a sweep over its centre, for each frame and each map.
    pub passes: usize,
    /// The frames, and how many lines of each were read in all passes of all searches; of a sweep its centre alone, since each line
    /// of a frame is read once.
    pub lines_read: Vec<(Frame, usize)>,
    /// Size of the firmware's workspace in bytes.
    pub workspace: usize,
}

/// The reason why frames cannot be simulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The frames do not have the size of the profile.
    #[error("found frames of {}x{} pixels, expected {}x{} for profile {profile}", found[0], found[1], expected[0], expected[1])]
    FrameSize {
        /// Name of the profile.
        profile: &'static str,
        /// Width and height of the frames.
        found: [usize; 2],
        /// Width and height that the profile needs.
        expected: [usize; 2],
    },
    /// A view of the profile is missing.
    #[error("the {view} view is missing")]
    MissingView {
        /// The view.
        view: View,
    },
}

/// Runs the pipeline of `profile` on `frames`, in a workspace like the firmware's. Calls `on_line` for
/// each line of the centre that it reads.
///
/// # Errors
/// The frames have another size than the profile's, or a view is missing.
pub fn simulate(
    profile: &Profile,
    fusion: Fusion,
    frames: &Planes<'_>,
    on_line: &dyn Fn(),
) -> Result<Simulation, SimulationError> {
    let matching = profile.matching(fusion);
    let (found, expected) = (frames.size(), [matching.search().width(), matching.search().height()]);
    if found != expected {
        return Err(SimulationError::FrameSize { profile: profile.name, found, expected });
    }
    let mut board = SimulatedBoard { frames, on_line };
    let mut sources = matching.searches().map(|search| board.frames(search)).collect::<Result<Vec<_>, _>>()?;
    let mut packets = board.output()?;
    let lengths = matching.lengths_with::<Baseline>();
    let (mut words, mut line, mut packet) = (vec![0; lengths.words()], vec![None; lengths.columns], vec![0; lengths.packet]);
    let pipeline = Pipeline::with_kernel(Baseline::default(), &mut words, &mut line, &mut packet);
    let run = pipeline.run::<SimulatedBoard<'_>, _>(&matching, &mut sources, &mut packets);
    let mut sender = run.unwrap_or_else(|error| panic!("the workspace fits the profile and memory can be read: {error}"));
    packets.extend_from_slice(sender.end(None).expect("the end is shorter than a line"));
    let passes = sources.iter().map(|source| source.passes).max().unwrap_or_default();
    let mut lines_read: Vec<(Frame, usize)> = Vec::new();
    for (frame, lines) in sources.into_iter().flat_map(|source| source.lines_read) {
        match lines_read.iter_mut().find(|(other, _)| *other == frame) {
            Some((_, sum)) => *sum += lines,
            None => lines_read.push((frame, lines)),
        }
    }
    Ok(Simulation { packets, passes, lines_read, workspace: matching.lengths().bytes() })
}

/// Runs the pipeline of a sweep on `frames` at their places, in this order, in a workspace like the firmware's, and sends a map after
/// each `every` frames and after the last. Calls `on_line` for each line that it reads.
///
/// # Errors
/// The centre or a frame has another size than the profile's.
///
/// # Panics
/// If `every` is 0.
pub fn simulate_sweep(
    profile: &SweepProfile,
    center: &Planes<'_>,
    frames: &[(SweepOffset, Planes<'_>)],
    every: usize,
    on_line: &dyn Fn(),
) -> Result<Simulation, SimulationError> {
    let (params, search) = (&profile.params, profile.params.search());
    let expected = [search.width(), search.height()];
    if let Some(found) =
        iter::once(center).chain(frames.iter().map(|(_, frame)| frame)).map(Planes::size).find(|size| *size != expected)
    {
        return Err(SimulationError::FrameSize { profile: profile.name, found, expected });
    }
    let lengths = profile.lengths();
    let (mut words, mut line, mut packet) = (vec![0; lengths.words()], vec![None; lengths.columns], vec![0; lengths.packet]);
    let pipeline = SweepPipeline::new(params, &mut words, &mut line, &mut packet);
    let mut pipeline = pipeline.expect("the workspace fits the profile");
    let (mut source, mut packets) = (CountedStreams::open(center, Views::NONE, on_line), Vec::new());
    for (n, (offset, frame)) in (1..).zip(frames) {
        let mut frame = CountedStreams::open(frame, Views::NONE, on_line);
        pipeline.refine::<SimulatedBoard<'_>>(*offset, &mut source, &mut frame).expect("memory can be read");
        if n % every == 0 || n == frames.len() {
            let sent = pipeline.send::<SimulatedBoard<'_>>(&mut source, &mut packets);
            let mut sender = sent.expect("memory can be read, and the workspace fits the profile");
            packets.extend_from_slice(sender.end(None).expect("the end is shorter than a line"));
        }
    }
    // The first of the passes is a rewind before anything is read.
    Ok(Simulation { packets, passes: source.passes - 1, lines_read: source.lines_read, workspace: lengths.bytes() })
}

/// A board whose frames are in memory.
struct SimulatedBoard<'a> {
    frames: &'a Planes<'a>,
    on_line: &'a dyn Fn(),
}

impl<'a> Board for SimulatedBoard<'a> {
    type Frames = CountedStreams<'a>;
    type Output = Vec<u8>;
    type Error = SimulationError;

    fn frames(&mut self, search: &SearchSpace) -> Result<CountedStreams<'a>, SimulationError> {
        let (frames, views) = (self.frames, search.views());
        if let Some(view) = views.iter().find(|&view| frames.get(Frame::View(view)).is_none()) {
            return Err(SimulationError::MissingView { view });
        }
        Ok(CountedStreams::open(frames, views, self.on_line))
    }

    fn output(&mut self) -> Result<Vec<u8>, SimulationError> {
        Ok(Vec::new())
    }

    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }

    fn enter(_: Phase) {}
}

/// The firmware's streams, with counts of what is read from them.
struct CountedStreams<'a> {
    frames: &'a Planes<'a>,
    views: Views,
    streams: Streams<&'a [u8]>,
    lines_read: Vec<(Frame, usize)>,
    passes: usize,
    on_line: &'a dyn Fn(),
}

impl<'a> CountedStreams<'a> {
    /// The streams of frames that are there.
    fn open(frames: &'a Planes<'a>, views: Views, on_line: &'a dyn Fn()) -> CountedStreams<'a> {
        let streams = open_streams(frames, views);
        let lines_read = iter::once(Frame::Center).chain(views.iter().map(Frame::View)).map(|frame| (frame, 0)).collect();
        CountedStreams { frames, views, streams, lines_read, passes: 1, on_line }
    }
}

impl ScanlineSource for CountedStreams<'_> {
    type Error = StreamsError<Infallible>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let lines_read = self.lines_read.iter_mut().find(|(other, _)| *other == frame);
        lines_read.expect("the board has every view").1 += 1;
        if frame == Frame::Center {
            (self.on_line)();
        }
        self.streams.read_line(frame, v, line)
    }
}

impl Rewind for CountedStreams<'_> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        self.passes += 1;
        self.streams = open_streams(self.frames, self.views);
        Ok(())
    }
}

fn open_streams<'a>(frames: &Planes<'a>, views: Views) -> Streams<&'a [u8]> {
    let pixels = |frame| Ok::<_, Infallible>(frames.get(frame).expect("the board has every view"));
    let Ok(streams) = Streams::open(views, pixels);
    streams
}
