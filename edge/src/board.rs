//! What the firmware asks of a board.

use core::time::Duration;
use embedded_io::Write;
use multiscopic_core::{Params, Rewind};

/// A board: the frames it holds, the way out for disparities, and a clock.
///
/// For a board of one's own, with frames in flash and a serial port:
///
/// ```
/// use core::{convert::Infallible, time::Duration};
/// use embedded_io::Write;
/// use multiscopic_core::{Frame, Fusion, Params, Rewind, ScanlineSource, Views};
/// use multiscopic_edge::{Board, Kernel, Lengths, Phase, Workspace};
///
/// const PARAMS: Params = match Params::new(96, 64, Views::HORIZONTAL, Fusion::Min, 1, 16, 7) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// /// All columns in one pass. Narrower tiles take less memory: `multiscopic budget` says how much.
/// const TILE: usize = PARAMS.width();
/// const LENGTHS: Lengths = Lengths::new::<Kernel>(&PARAMS, TILE);
/// type Memory = Workspace<{ LENGTHS.matcher.words() }, { LENGTHS.columns }, { LENGTHS.packet }>;
/// // The build fails where it does not fit.
/// const _: () = assert!(size_of::<Memory>() < 20 * 1024, "use narrower tiles: TILE");
///
/// /// Frames in flash, or anything else that has lines.
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
///             Frame::View(view) => self.frames[1 + view as usize],
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
/// /// `Serial` is the serial port of a HAL: anything that `embedded_io` can write to.
/// struct Mine<Serial> {
///     serial: Option<Serial>,
/// }
///
/// impl<Serial: Write> Board for Mine<Serial> {
///     type Frames = Flash;
///     type Output = Serial;
///     type Error = &'static str;
///
///     fn frames(&mut self, _: &Params) -> Result<Flash, &'static str> {
///         // Here: include_bytes!, a camera's buffers, external memory.
///         Ok(Flash { frames: [&[7; 96 * 64]; 3] })
///     }
///
///     fn output(&mut self) -> Result<Serial, &'static str> {
///         self.serial.take().ok_or("the serial port is taken")
///     }
///
///     fn elapsed(&self) -> Duration {
///         Duration::ZERO // of a timer
///     }
///
///     fn enter(_: Phase) {}
/// }
///
/// fn send_disparities<Serial: Write>(board: &mut Mine<Serial>, memory: &mut Memory) -> Result<(), &'static str> {
///     let (mut frames, mut serial) = (board.frames(&PARAMS)?, board.output()?);
///     let run = memory.pipeline().run::<Mine<Serial>>(&PARAMS, TILE, &mut frames, &mut serial);
///     let mut sender = run.map_err(|_| "a line was not matched or sent")?;
///     let end = sender.end(None).map_err(|_| "the packet is too small")?;
///     serial.write_all(end).map_err(|_| "the end was not sent")
/// }
/// # let mut sent = [0; 20_000];
/// # let mut memory = Box::new(Memory::new());
/// # send_disparities(&mut Mine { serial: Some(&mut sent[..]) }, &mut memory).unwrap();
/// # assert!(sent.split(|&byte| byte == 0).filter(|packet| !packet.is_empty()).count() == 65);
/// ```
///
/// In firmware the workspace is a static, as `static_cell::ConstStaticCell` makes it. `multiscopic listen` shows on a host what comes
/// out of the port.
pub trait Board {
    /// The stored frames. They are read by the line and in order, again for each column tile.
    type Frames: Rewind;
    /// Where packets go.
    type Output: Write;
    /// Why the board cannot serve.
    type Error;

    /// The frames to match.
    ///
    /// # Errors
    /// A frame is missing or has another size than `params` say.
    fn frames(&mut self, params: &Params) -> Result<Self::Frames, Self::Error>;

    /// The way out.
    ///
    /// # Errors
    /// There is none.
    fn output(&mut self) -> Result<Self::Output, Self::Error>;

    /// The time since the start.
    fn elapsed(&self) -> Duration;

    /// Marks that the work goes over to another phase: a place for a pin that a scope watches, or for counting.
    fn enter(phase: Phase);
}

/// What the firmware is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Anything else.
    Idle,
    /// Matching.
    Matching,
    /// Fetching a line from the store.
    Fetching,
    /// Encoding and sending a disparity line.
    Sending,
}
