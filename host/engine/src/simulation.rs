//! The firmware's pipeline on the host: the same parameters, memory, order of lines and packets, with frames
//! in memory.

use std::{convert::Infallible, iter, time::Duration};

use multiscopic_core::{Frame, Fusion, Rewind, ScanlineSource, Search, View, Views, kernel::Kernel};
use multiscopic_edge::{Board, Matching, Phase, Profile, Streams, StreamsError, Wide, Workspace, profile, workspace};

use crate::{error::Error, images::Frames};

/// The firmware's work on a set of frames: the packets that it sends, and the lines and the memory that it takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// The packets that it sends, byte for byte, except that the last one does not tell the depth of the
    /// stack: only the processor can measure it.
    pub packets: Vec<u8>,
    /// Passes over the frames, one for each column tile.
    pub passes: usize,
    /// The frames, and how many lines of each were read in all passes of all searches.
    pub lines_read: Vec<(Frame, usize)>,
    /// Size of the workspace in bytes.
    pub workspace: usize,
}

/// The reason why frames cannot be simulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The profile is not one of [`profile::ALL`], whose workspaces are compiled in.
    #[error("found profile {name}, expected one of {}", profile::ALL.map(|profile| profile.name).join(", "))]
    UnknownProfile {
        /// Its name.
        name: &'static str,
    },
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

impl From<SimulationError> for Error {
    fn from(error: SimulationError) -> Error {
        Error::Usage(error.to_string())
    }
}

/// Runs the pipeline of `profile` on `frames`, in a workspace as the firmware has it. Calls `on_line` for
/// each line of the centre that it reads.
///
/// # Errors
/// The frames have another size than the profile's, a view is missing, or the profile is unknown.
pub fn simulate(profile: &Profile, fusion: Fusion, frames: &Frames, on_line: &dyn Fn()) -> Result<Simulation, SimulationError> {
    let matching = profile.matching(fusion);
    let (found, expected) = (frames.size(), [matching.search().width(), matching.search().height()]);
    if found != expected {
        return Err(SimulationError::FrameSize { profile: profile.name, found, expected });
    }
    let mut board = SimulatedBoard { frames, on_line };
    // The lengths of a workspace are part of its type, so each profile is a case of its own.
    macro_rules! run {
        ($($known:path),*) => {
            match profile.name {
                $(name if name == $known.name => {
                    let mut workspace = Box::<workspace!(Wide, $known)>::new(Workspace::new());
                    run(Wide::default(), &mut *workspace, &matching, &mut board)
                })*
                name => Err(SimulationError::UnknownProfile { name }),
            }
        };
    }
    run!(
        profile::QQVGA_3X3,
        profile::QVGA_PRIOR,
        profile::QVGA_CONFIDENCE,
        profile::QQVGA_SGM_CONFIDENCE,
        profile::QQVGA_NET,
        profile::QQVGA,
        profile::QVGA,
        profile::QVGA_TILED,
        profile::VGA,
        profile::VGA_TILED,
        profile::QQVGA_SGM,
        profile::QVGA_SGM
    )
}

fn run<I: Kernel, const WORDS: usize, const COLUMNS: usize, const PACKET: usize>(
    kernel: I,
    workspace: &mut Workspace<WORDS, COLUMNS, PACKET>,
    matching: &Matching,
    board: &mut SimulatedBoard<'_>,
) -> Result<Simulation, SimulationError> {
    let mut sources = matching.searches().map(|search| board.frames(search)).collect::<Result<Vec<_>, _>>()?;
    let mut packets = board.output()?;
    let run = workspace.pipeline().run::<SimulatedBoard<'_>, I>(kernel, matching, &mut sources, &mut packets);
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
    Ok(Simulation { packets, passes, lines_read, workspace: size_of_val(workspace) })
}

/// A board whose frames are in memory.
struct SimulatedBoard<'a> {
    frames: &'a Frames,
    on_line: &'a dyn Fn(),
}

impl<'a> Board for SimulatedBoard<'a> {
    type Frames = CountedStreams<'a>;
    type Output = Vec<u8>;
    type Error = SimulationError;

    fn frames(&mut self, search: &Search) -> Result<CountedStreams<'a>, SimulationError> {
        let (frames, views) = (self.frames, search.views());
        if let Some(view) = views.iter().find(|&view| frames.get(Frame::View(view)).is_none()) {
            return Err(SimulationError::MissingView { view });
        }
        let streams = open_streams(frames, views);
        let lines_read = iter::once(Frame::Center).chain(views.iter().map(Frame::View)).map(|frame| (frame, 0)).collect();
        Ok(CountedStreams { frames, views, streams, lines_read, passes: 1, on_line: self.on_line })
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
    frames: &'a Frames,
    views: Views,
    streams: Streams<&'a [u8]>,
    lines_read: Vec<(Frame, usize)>,
    passes: usize,
    on_line: &'a dyn Fn(),
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

fn open_streams(frames: &Frames, views: Views) -> Streams<&[u8]> {
    let pixels = |frame| Ok::<_, Infallible>(frames.get(frame).expect("the board has every view").as_raw().as_slice());
    let Ok(streams) = Streams::open(views, pixels);
    streams
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        files::Limits,
        scene::{PinholeCamera, Scene, render},
        target::reception::{Notice, receive},
    };
    use std::path::Path;

    fn demo_frames(width: u32, views: Views) -> Frames {
        render(&Scene::demo(), &PinholeCamera::new(width, 120), 1).frames(views)
    }

    /// The workspace's tests in `tests/` run every profile, and compare it with `multiscopic match`.
    #[test]
    fn the_pipeline_runs_in_its_workspace() {
        let profile = profile::QQVGA;
        let frames = demo_frames(160, profile.matching(Fusion::Min).search().views());
        let simulation = simulate(&profile, Fusion::Min, &frames, &|| ()).unwrap();
        assert_eq!(simulation.workspace, profile.lengths::<Wide>().bytes());
        assert_eq!(simulation.passes, 1);
        let views = [View::LEFT, View::RIGHT].map(Frame::View);
        assert_eq!(simulation.lines_read, [(Frame::Center, 120), (views[0], 120), (views[1], 120)]);
        let received = receive(&simulation.packets[..], Path::new("simulation"), Limits::DEFAULT, |notice| {
            assert!(matches!(notice, Notice::Line { .. }), "{notice:?}");
        });
        let received = received.unwrap();
        assert_eq!((received.is_complete(), received.stack), (true, None));
    }

    #[test]
    fn frames_that_do_not_fit_the_profile_are_refused() {
        let refusal = |frames| simulate(&profile::QQVGA, Fusion::Min, &frames, &|| ()).unwrap_err();
        let missing = refusal(demo_frames(160, Views::STEREO));
        assert_eq!(missing, SimulationError::MissingView { view: View::LEFT });
        let small = refusal(demo_frames(80, Views::HORIZONTAL));
        let expected = SimulationError::FrameSize { profile: "qqvga", found: [80, 120], expected: [160, 120] };
        assert_eq!(small, expected);
        assert_eq!(small.to_string(), "found frames of 80x120 pixels, expected 160x120 for profile qqvga");
    }
}
