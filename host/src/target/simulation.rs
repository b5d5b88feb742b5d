//! The firmware's pipeline on the host: its parameters, its memory and its order of lines, with frames in memory.

use std::{convert::Infallible, time::Duration};

use embedded_io::{ErrorType, Read, Seek, SeekFrom};
use multiscopic_core::{Frame, Fusion, Params, Rewind, ScanlineSource, View, kernel::Blocks};
use multiscopic_edge::{Board, Phase, Profile, Streams, StreamsError, Wide, Workspace, profile, workspace};

use crate::images::Frames;

/// What the firmware of a profile does with some frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// The packets that it sends, byte for byte; but the last one, the frame's end, has no depth of the stack, which can be measured
    /// on the processor alone.
    pub packets: Vec<u8>,
    /// Passes over the frames, one for each column tile.
    pub passes: usize,
    /// The frames, and how many of their lines were read in all passes.
    pub lines_read: Vec<(Frame, usize)>,
    /// The size of the workspace, in bytes.
    pub workspace: usize,
}

/// Runs the pipeline of `profile` on `frames`, in the memory that it has in firmware, and calls `line_read` for every line of the centre that it reads.
///
/// # Panics
/// If the frames are not as large as the profile's, or a view of it is missing.
pub fn simulate(profile: &Profile, fusion: Fusion, frames: &Frames, line_read: &dyn Fn()) -> Simulation {
    let params = profile.params(fusion);
    assert_eq!(frames.size(), [params.width(), params.height()], "the size of the frames for {}", profile.name);
    let mut desk = Desk { frames, line_read };
    // The lengths of a workspace are part of its type.
    macro_rules! run {
        ($($known:path),*) => {
            match profile.name {
                $(name if name == $known.name => {
                    let mut workspace = Box::<workspace!(Wide, $known)>::new(Workspace::new());
                    run(Wide::default(), &mut *workspace, &params, profile.tile_width(), &mut desk)
                })*
                name => unreachable!("{name} is not a profile"),
            }
        };
    }
    run!(profile::QQVGA, profile::QVGA, profile::QVGA_TILED, profile::VGA, profile::VGA_TILED)
}

fn run<I: Blocks<u16> + Blocks<u32>, const WORDS: usize, const COLUMNS: usize, const PACKET: usize>(
    kernel: I,
    workspace: &mut Workspace<WORDS, COLUMNS, PACKET>,
    params: &Params,
    tile_width: usize,
    desk: &mut Desk<'_>,
) -> Simulation {
    let (Ok(mut source), Ok(mut packets)) = (desk.frames(params), desk.output());
    let run = workspace.pipeline().run::<Desk<'_>, I>(kernel, params, tile_width, &mut source, &mut packets);
    let mut sender = run.unwrap_or_else(|error| panic!("the workspace is the profile's and memory can be read: {error}"));
    packets.extend_from_slice(sender.end(None).expect("an end takes less room than a line"));
    let frames = [Frame::Center].into_iter().chain(params.views().iter().map(Frame::View));
    Simulation {
        packets,
        passes: source.passes,
        lines_read: frames.map(|frame| (frame, source.lines[place(frame)])).collect(),
        workspace: size_of_val(workspace),
    }
}

/// A board with frames in memory.
struct Desk<'a> {
    frames: &'a Frames,
    line_read: &'a dyn Fn(),
}

impl<'a> Board for Desk<'a> {
    type Frames = Counted<'a>;
    type Output = Vec<u8>;
    type Error = Infallible;

    fn frames(&mut self, params: &Params) -> Result<Counted<'a>, Infallible> {
        let open = |frame| {
            let image = self.frames.get(frame).unwrap_or_else(|| panic!("the frame {frame:?} is missing"));
            Ok::<_, Infallible>(Stored { pixels: image.as_raw(), next: 0 })
        };
        Ok(Counted { streams: Streams::open(params.views(), open)?, lines: [0; 5], passes: 1, line_read: self.line_read })
    }

    fn output(&mut self) -> Result<Vec<u8>, Infallible> {
        Ok(Vec::new())
    }

    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }

    fn enter(_: Phase) {}
}

/// The firmware's streams, and how often they are read.
struct Counted<'a> {
    streams: Streams<Stored<'a>>,
    lines: [usize; 1 + View::ALL.len()],
    passes: usize,
    line_read: &'a dyn Fn(),
}

const fn place(frame: Frame) -> usize {
    match frame {
        Frame::Center => 0,
        Frame::View(view) => 1 + view as usize,
    }
}

impl ScanlineSource for Counted<'_> {
    type Error = StreamsError<Infallible>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        self.lines[place(frame)] += 1;
        if frame == Frame::Center {
            (self.line_read)();
        }
        self.streams.read_line(frame, v, line)
    }
}

impl Rewind for Counted<'_> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        self.passes += 1;
        self.streams.rewind()
    }
}

/// Pixels in memory as a file.
struct Stored<'a> {
    pixels: &'a [u8],
    next: usize,
}

impl ErrorType for Stored<'_> {
    type Error = Infallible;
}

impl Read for Stored<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        let read = self.pixels.get(self.next..).unwrap_or_default().read(bytes)?;
        self.next += read;
        Ok(read)
    }
}

impl Seek for Stored<'_> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64, Infallible> {
        let to = match to {
            SeekFrom::Start(offset) => offset,
            SeekFrom::End(offset) => (self.pixels.len() as u64).saturating_add_signed(offset),
            SeekFrom::Current(offset) => (self.next as u64).saturating_add_signed(offset),
        };
        self.next = to as usize;
        Ok(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        scene::{Camera, Scene, capture},
        target::reception::{Notice, receive},
    };
    use multiscopic_core::Views;
    use std::path::Path;

    /// In tests/ every profile runs, and is compared with `match`.
    #[test]
    fn the_pipeline_runs_in_its_workspace() {
        let profile = profile::QQVGA;
        let params = profile.params(Fusion::Min);
        let frames = capture(&Scene::demo(), &Camera::new(160, 120), 1).frames(params.views());
        let simulation = simulate(&profile, Fusion::Min, &frames, &|| ());
        assert_eq!(simulation.workspace, profile.lengths::<Wide>().bytes());
        assert_eq!(simulation.passes, 1);
        let views = [View::Left, View::Right].map(Frame::View);
        assert_eq!(simulation.lines_read, [(Frame::Center, 120), (views[0], 120), (views[1], 120)]);
        let received = receive(&simulation.packets[..], Path::new("simulation"), |notice| {
            assert!(matches!(notice, Notice::Line { .. }), "{notice:?}");
        });
        let received = received.unwrap();
        assert_eq!((received.is_complete(), received.stack), (true, None));
    }

    #[test]
    #[should_panic = "the frame View(Left) is missing"]
    fn a_view_that_is_missing_is_named() {
        let frames = capture(&Scene::demo(), &Camera::new(160, 120), 1).frames(Views::STEREO);
        simulate(&profile::QQVGA, Fusion::Min, &frames, &|| ());
    }
}
