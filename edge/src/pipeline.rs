//! From scanlines to packets.

use core::{error, fmt, marker::PhantomData};
use embedded_io::Write;
use multiscopic_core::{
    Disparity, Frame, MatchError, Matcher, Memory, MemoryTooSmall, Params, Region, Rewind, ScanlineSource,
    kernel::{Blocks, Isa},
};

use crate::{
    Board, Kernel, Phase,
    packet::{self, BufferTooSmall, Sender},
};

/// How long the parts of a [`Workspace`] are for a match in column tiles of some width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lengths {
    /// The matcher's memory by buffer.
    pub matcher: Memory,
    /// Disparities of a line.
    pub columns: usize,
    /// Bytes of the buffer that packets are encoded in.
    pub packet: usize,
}

impl Lengths {
    /// Those for tiles of `tile_width` columns, all of them if the frame is matched in one pass, and for a kernel: [`Kernel`] in
    /// firmware.
    pub const fn new<I: Isa>(params: &Params, tile_width: usize) -> Lengths {
        Lengths { matcher: Memory::new::<I>(params, tile_width), columns: tile_width, packet: packet::buffer_bytes(tile_width) }
    }

    /// The size of such a workspace, in bytes.
    pub const fn bytes(&self) -> usize {
        (4 * self.matcher.words() + self.line_bytes() + self.packet).next_multiple_of(align_of::<u32>())
    }

    /// Bytes of a line of disparities.
    pub const fn line_bytes(&self) -> usize {
        self.columns * size_of::<Option<Disparity>>()
    }
}

/// The memory of a pipeline. Its [`Lengths`] follow from the profile: [`workspace!`](crate::workspace) is the type with them.
pub struct Workspace<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> {
    matcher: [u32; WORDS],
    line: [Option<Disparity>; COLUMNS],
    packet: [u8; PACKET],
}

impl<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> Workspace<WORDS, COLUMNS, PACKET> {
    /// An empty workspace.
    #[expect(clippy::new_without_default, reason = "a static is initialised with it")]
    pub const fn new() -> Self {
        Workspace { matcher: [0; WORDS], line: [None; COLUMNS], packet: [0; PACKET] }
    }

    /// The pipeline that works in it.
    pub fn pipeline(&mut self) -> Pipeline<'_> {
        Pipeline { matcher: &mut self.matcher, line: &mut self.line, packet: &mut self.packet }
    }
}

/// Matches frames and sends the disparities, in memory of its own.
#[derive(Debug)]
pub struct Pipeline<'w> {
    matcher: &'w mut [u32],
    line: &'w mut [Option<Disparity>],
    packet: &'w mut [u8],
}

impl<'w> Pipeline<'w> {
    /// Matches the frames of `source` in column tiles and sends each disparity line to `output` as soon as it is there. The
    /// sender comes back for the packet that ends the frame.
    ///
    /// # Errors
    /// Those of the source, the matcher and the output.
    pub fn run<B: Board>(
        self,
        params: &Params,
        tile_width: usize,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        self.run_with::<B, Kernel>(Kernel::default(), params, tile_width, source, output)
    }

    /// The same with a kernel of choice: with as many lanes, it takes the memory of another processor's.
    ///
    /// # Errors
    /// Those of the source, the matcher and the output.
    pub fn run_with<B: Board, I: Blocks<u16> + Blocks<u32>>(
        self,
        kernel: I,
        params: &Params,
        tile_width: usize,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let mut sender = Sender::new(params, self.packet);
        for (pass, tile) in Region::tiles(params, tile_width).enumerate() {
            if pass > 0 {
                source.rewind().map_err(PipelineError::Rewind)?;
            }
            B::enter(Phase::Matching);
            let columns = tile.width();
            let given = self.line.len();
            let line = self.line.get_mut(..columns).ok_or(PipelineError::Line { needed: columns, given })?;
            let mut matcher = Matcher::with_isa(kernel, params, &tile, self.matcher).map_err(PipelineError::Memory)?;
            while let Some(v) = matcher.next_line(&mut Fetching::<B>::new(source), line).map_err(PipelineError::Match)? {
                B::enter(Phase::Sending);
                let packet = sender.line(&tile, v, line).map_err(PipelineError::Packet)?;
                output.write_all(packet).map_err(PipelineError::Write)?;
                B::enter(Phase::Matching);
            }
            B::enter(Phase::Idle);
        }
        Ok(sender)
    }
}

/// A board's frames, whose fetching is marked.
struct Fetching<'a, B: Board> {
    source: &'a mut B::Frames,
    board: PhantomData<B>,
}

impl<'a, B: Board> Fetching<'a, B> {
    fn new(source: &'a mut B::Frames) -> Self {
        Fetching { source, board: PhantomData }
    }
}

impl<B: Board> ScanlineSource for Fetching<'_, B> {
    type Error = <B::Frames as ScanlineSource>::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        B::enter(Phase::Fetching);
        let done = self.source.read_line(frame, v, line);
        B::enter(Phase::Matching);
        done
    }
}

/// Why a pipeline on board `B` ended before its last line.
pub type RunError<B> =
    PipelineError<<<B as Board>::Frames as ScanlineSource>::Error, <<B as Board>::Output as embedded_io::ErrorType>::Error>;

/// Why a pipeline ended before its last line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PipelineError<S, W> {
    /// The workspace is for narrower tiles.
    Line {
        /// Pixels of the tile.
        needed: usize,
        /// Pixels of the workspace's line.
        given: usize,
    },
    /// The workspace is for other parameters.
    Memory(MemoryTooSmall),
    /// The frames cannot be read again.
    Rewind(S),
    /// A line could not be matched.
    Match(MatchError<S>),
    /// A line does not fit into its packet.
    Packet(BufferTooSmall),
    /// A line could not be sent.
    Write(W),
}

impl<S: fmt::Display, W: fmt::Display> fmt::Display for PipelineError<S, W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PipelineError::Line { needed, given } => write!(f, "a tile has {needed} columns, the workspace {given}"),
            PipelineError::Memory(error) => write!(f, "{error}"),
            PipelineError::Rewind(error) => write!(f, "cannot go back to the first line: {error}"),
            PipelineError::Match(error) => write!(f, "{error}"),
            PipelineError::Packet(error) => write!(f, "{error}"),
            PipelineError::Write(error) => write!(f, "cannot send a disparity line: {error}"),
        }
    }
}

impl<S: error::Error, W: error::Error> error::Error for PipelineError<S, W> {}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::{
        packet::{Content, Packet},
        profile,
    };
    use core::{convert::Infallible, time::Duration};
    use embedded_io::{ErrorType, SliceWriteError};
    use multiscopic_core::{Fusion, Views};
    use std::{vec, vec::Vec};

    const PARAMS: Params = match Params::new(24, 20, Views::ALL, Fusion::Heuristic, 1, 4, 3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };
    const WORDS: usize = Lengths::new::<Kernel>(&PARAMS, PARAMS.width()).matcher.words();
    const PACKET: usize = Lengths::new::<Kernel>(&PARAMS, PARAMS.width()).packet;

    /// A slope two pixels away from the infinite, which counts how often it is read.
    #[derive(Default)]
    struct Slope {
        rewinds: usize,
    }

    impl ScanlineSource for Slope {
        type Error = Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
            let (du, dv) = match frame {
                Frame::Center => (0, 0),
                Frame::View(view) if view.is_horizontal() => (2 * view.sign(), 0),
                Frame::View(view) => (0, 2 * view.sign()),
            };
            for (pixel, u) in line.iter_mut().zip(0..) {
                *pixel = (20 + 3 * (u - du) + 5 * (v as i32 - dv)) as u8;
            }
            Ok(())
        }
    }

    impl Rewind for Slope {
        fn rewind(&mut self) -> Result<(), Infallible> {
            self.rewinds += 1;
            Ok(())
        }
    }

    /// A way out for so many bytes.
    struct Output {
        sent: Vec<u8>,
        room: usize,
    }

    impl ErrorType for Output {
        type Error = SliceWriteError;
    }

    impl Write for Output {
        fn write(&mut self, bytes: &[u8]) -> Result<usize, SliceWriteError> {
            if self.sent.len() + bytes.len() > self.room {
                return Err(SliceWriteError::Full);
            }
            self.sent.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> Result<(), SliceWriteError> {
            Ok(())
        }
    }

    struct Desk;

    impl Board for Desk {
        type Frames = Slope;
        type Output = Output;
        type Error = Infallible;

        fn frames(&mut self, _: &Params) -> Result<Slope, Infallible> {
            Ok(Slope::default())
        }

        fn output(&mut self) -> Result<Output, Infallible> {
            Ok(Output { sent: Vec::new(), room: usize::MAX })
        }

        fn elapsed(&self) -> Duration {
            Duration::ZERO
        }

        fn enter(_: Phase) {}
    }

    /// The pixels that a pipeline sends, and how often it goes back.
    fn matched(tile_width: usize) -> (Vec<Option<Option<Disparity>>>, usize) {
        let Ok(mut source) = Desk.frames(&PARAMS);
        let Ok(mut output) = Desk.output();
        let mut workspace = Workspace::<WORDS, { PARAMS.width() }, PACKET>::new();
        workspace.pipeline().run::<Desk>(&PARAMS, tile_width, &mut source, &mut output).unwrap();
        let mut pixels = vec![None; PARAMS.width() * PARAMS.height()];
        assert_eq!(output.sent.pop(), Some(0));
        for bytes in output.sent.split_mut(|&byte| byte == 0) {
            let packet = Packet::decode(bytes).unwrap();
            let Content::Line { line, left, .. } = packet.header.content else { panic!("only lines were sent") };
            let start = usize::from(line) * PARAMS.width() + usize::from(left);
            for (pixel, disparity) in pixels[start..].iter_mut().zip(packet.disparities()) {
                assert_eq!(pixel.replace(disparity), None);
            }
        }
        (pixels, source.rewinds)
    }

    #[test]
    fn the_lengths_are_those_of_the_statics() {
        let sizes = [
            size_of::<crate::workspace!(Kernel, profile::QQVGA)>(),
            size_of::<crate::workspace!(Kernel, profile::QVGA)>(),
            size_of::<crate::workspace!(Kernel, profile::QVGA_TILED)>(),
            size_of::<crate::workspace!(Kernel, profile::VGA)>(),
            size_of::<crate::workspace!(Kernel, profile::VGA_TILED)>(),
        ];
        assert_eq!(sizes, profile::ALL.map(|profile| profile.lengths::<Kernel>().bytes()));
        assert_eq!(size_of::<Workspace<WORDS, 24, PACKET>>(), Lengths::new::<Kernel>(&PARAMS, 24).bytes());
    }

    #[test]
    fn every_line_is_sent() {
        let (pixels, rewinds) = matched(PARAMS.width());
        assert!(pixels.iter().all(Option::is_some));
        assert_eq!(pixels[10 * PARAMS.width() + 12], Some(Disparity::from_bits(128)));
        assert_eq!(rewinds, 0);
    }

    #[test]
    fn tiles_are_the_same_frame() {
        let (whole, _) = matched(PARAMS.width());
        for (tile_width, passes) in [(12, 2), (7, 4), (1, 24)] {
            assert_eq!(matched(tile_width), (whole.clone(), passes - 1), "tiles of {tile_width} columns");
        }
    }

    #[test]
    fn an_output_that_is_full_ends_it() {
        let mut workspace = Workspace::<WORDS, { PARAMS.width() }, PACKET>::new();
        let mut output = Output { sent: Vec::new(), room: 150 };
        let end = workspace.pipeline().run::<Desk>(&PARAMS, PARAMS.width(), &mut Slope::default(), &mut output);
        assert_eq!(end.err(), Some(PipelineError::Write(SliceWriteError::Full)));
    }
}
