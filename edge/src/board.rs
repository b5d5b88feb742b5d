//! The hardware that a pipeline needs.

use core::time::Duration;
use embedded_io::Write;
use multiscopic_core::{Rewind, SearchSpace};

/// A board: stored frames, an output for packets, and a clock.
///
/// An example with frames in flash and a serial port:
///
/// ```
/// use core::{convert::Infallible, time::Duration};
/// use embedded_io::Write;
/// use multiscopic_core::{
///     BlockMatchingParams, Frame, Fusion, Rewind, ScanlineSource, SearchConfig, SearchSpace, View, Views, params, valid,
/// };
/// use multiscopic_edge::{Board, Matching, Phase, workspace};
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(96, 64) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));
/// // All columns in one pass. Narrower tiles take less memory: `multiscopic budget` says how much.
/// params!(Match: Matching = Ok(Matching::Blocks { params: PARAMS, tile_width: PARAMS.width() }));
/// type Memory = workspace!(Match::PARAMS);
/// // Fails the build if the workspace is too large.
/// const _: () = assert!(size_of::<Memory>() < 20 * 1024, "use a smaller tile_width");
///
/// /// Frames in flash, or in anything else that can be read by the line.
/// struct Flash {
///     frames: [&'static [u8]; 3],
/// }
///
/// impl ScanlineSource for Flash {
///     type Error = Infallible;
///
///     fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
///         let frame = match frame {
///             Frame::Center => self.frames[0],
///             Frame::View(View::LEFT) => self.frames[1],
///             Frame::View(_) => self.frames[2],
///         };
///         line.copy_from_slice(&frame[v * PARAMS.width()..][..PARAMS.width()]);
///         Ok(())
///     }
/// }
///
/// impl Rewind for Flash {
///     fn rewind(&mut self) -> Result<(), Infallible> {
///         Ok(())
///     }
/// }
///
/// /// `Serial` is a serial port of any HAL that implements `embedded_io::Write`.
/// struct MyBoard<Serial> {
///     serial: Option<Serial>,
/// }
///
/// impl<Serial: Write> Board for MyBoard<Serial> {
///     type Frames = Flash;
///     type Output = Serial;
///     type Error = &'static str;
///
///     fn frames(&mut self, _: &SearchSpace) -> Result<Flash, &'static str> {
///         // In firmware: include_bytes!, a camera's buffers, external memory.
///         Ok(Flash { frames: [&[7; 96 * 64]; 3] })
///     }
///
///     fn output(&mut self) -> Result<Serial, &'static str> {
///         self.serial.take().ok_or("the serial port is taken")
///     }
///
///     fn elapsed(&self) -> Duration {
///         Duration::ZERO // In firmware: a timer.
///     }
///
///     fn enter(_: Phase) {}
/// }
///
/// fn send_disparities<Serial: Write>(board: &mut MyBoard<Serial>, memory: &mut Memory) -> Result<(), &'static str> {
///     let (frames, mut serial) = (board.frames(Match::PARAMS.search())?, board.output()?);
///     let run = memory.pipeline().run::<MyBoard<Serial>, _>(&Match, &mut [frames], &mut serial);
///     let mut sender = run.map_err(|_| "a line was not matched or sent")?;
///     let end = sender.end(None).map_err(|_| "the packet buffer is too small")?;
///     serial.write_all(end).map_err(|_| "the last packet was not sent")
/// }
/// # let mut sent = [0; 20_000];
/// # let mut memory = Box::new(Memory::new());
/// # send_disparities(&mut MyBoard { serial: Some(&mut sent[..]) }, &mut memory).unwrap();
/// # assert!(sent.split(|&byte| byte == 0).filter(|packet| !packet.is_empty()).count() == 65);
/// ```
///
/// In firmware the workspace is a static, for example a `static_cell::ConstStaticCell`. On the host,
/// `multiscopic listen` shows what the port sends.
pub trait Board {
    /// The stored frames. Lines are read in ascending order, once for each column tile and each of the
    /// [searches](crate::Matching::searches).
    type Frames: Rewind;
    /// The output of packets.
    type Output: Write;
    /// The error of frames or an output that are not available.
    type Error;

    /// Opens the frames of a search: the centre, and the views of `search`. Each search opens its own.
    ///
    /// # Errors
    /// A frame is missing, or its size differs from that of `search`.
    fn frames(&mut self, search: &SearchSpace) -> Result<Self::Frames, Self::Error>;

    /// Opens the output.
    ///
    /// # Errors
    /// The output is not available.
    fn output(&mut self) -> Result<Self::Output, Self::Error>;

    /// The time since the start.
    fn elapsed(&self) -> Duration;

    /// Called when the pipeline enters a phase: a place to set a pin for an oscilloscope, or to count cycles.
    fn enter(phase: Phase);
}

/// A phase of the pipeline's work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Phase {
    /// Nothing: before, between and after the passes over the frames.
    Idle,
    /// Matching.
    Matching,
    /// Reading a scanline.
    Fetching,
    /// Encoding and sending a disparity line.
    Sending,
}
