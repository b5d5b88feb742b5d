//! A camera with the sensor HM01B0 of Himax, a low-power sensor of 324x244 grey pixels.
//!
//! The sensor is configured over I2C and sends its pixels over a parallel bus of 8, 4 or 1 bits. An interrupt, or a
//! DMA transfer that it starts, puts the lines into a [`LineQueue`]. The camera takes them from there and
//! writes them to a [`FrameStore`]. The last frame of a plan need not be stored: the matcher can take its
//! lines during readout.
//!
//! ```
//! use core::time::Duration;
//! use embedded_hal::{delay::DelayNs, i2c::I2c};
//! use multiscopic_core::{
//!     Matcher, BlockMatchingParams, SearchConfig,
//!     capture::{Camera, Plan, Policy, CaptureProgress, Sequence, Stage}, valid,
//! };
//! use multiscopic_drivers::hm01b0::{Configuration, FrameMemory, Gain, Hm01b0, LineReceiver, Size};
//!
//! const SEARCH: SearchConfig = SearchConfig { num_disparities: 16, ..SearchConfig::of_size(160, 120) };
//! const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));
//! const CONFIGURATION: Configuration =
//!     Configuration { exposure_lines: 60, gain: Gain::X2, ..Configuration::new(Size::Qqvga) };
//!
//! /// Takes five frames, 20 mm apart, and matches them. The last one is matched during readout.
//! fn capture<S: Stage>(
//!     stage: &mut S,
//!     (i2c, delay, lines): (impl I2c, impl DelayNs, LineReceiver<'_, '_>),
//!     (frames, memory): (&mut [u8], &mut [u32]), // statics in firmware
//!     clock: impl Fn() -> Duration,
//! ) -> Option<()> {
//!     let plan = Plan::new(PARAMS.views(), 20_000);
//!     let mut camera = Hm01b0::new(i2c, delay, lines, FrameMemory::new(&PARAMS, frames), CONFIGURATION, plan);
//!     let mut sequence = Sequence::new(plan.positions(), Policy::default());
//!     let (mut matcher, mut line) = (Matcher::new(&PARAMS, memory).ok()?, [None; PARAMS.width()]);
//!     loop {
//!         match sequence.poll(clock(), stage, &mut camera) {
//!             Ok(CaptureProgress::Done) => return Some(()),
//!             // If the last frame is taken again, firmware may restart with a new matcher.
//!             Ok(CaptureProgress::Retrying(_)) | Err(_) => return None,
//!             Ok(CaptureProgress::Capturing(4)) => {}
//!             Ok(_) => continue,
//!         }
//!         // A line that has not arrived yet is requested again by the next call.
//!         if let Ok(Some(v)) = matcher.next_line(&mut camera, &mut line) {
//!             // line[u] is the disparity of pixel (u, v), if it has one.
//!         }
//!     }
//! }
//! ```

mod lines;
mod sensor;

pub use lines::{Arrival, LineQueue, LineReceiver, LineSender, PixelBus};
pub use sensor::{ClockDivider, Configuration, DataLines, Gain, Size};

use core::{error, fmt};
use embedded_hal::{
    delay::DelayNs,
    i2c::{ErrorKind, I2c},
};
use multiscopic_core::{
    BlockMatchingParams, Frame, Rewind, ScanlineSource,
    capture::{Camera, Plan},
};

use lines::{FrameDefect, Readout, SensorOutput};
use sensor::{Mode, Register};

/// The number of times that the sensor is asked if its reset is complete, a millisecond apart.
const RESET_POLLS: usize = 20;

/// The camera: registers on the I2C bus `I`, a delay `T`, lines from the bus `B`, frames in the store `S`.
///
/// It is a [`ScanlineSource`] of the frames of its plan: those in the store, and the last one during readout
/// if it is [streamed](Configuration::stream_last). A streamed line that has not arrived yet is the error
/// [`Waiting`](Hm01b0Error::Waiting); request it again, as the next call of
/// [`Matcher::next_line`](multiscopic_core::Matcher::next_line) does. A streamed frame is complete once all
/// its lines were read. Lines must not arrive faster than they are read: [`Configuration::line_clocks`] slows
/// the sensor down.
///
/// If a frame is damaged or lines are lost, [`is_complete`](Camera::is_complete) fails, and a
/// [`Sequence`](multiscopic_core::capture::Sequence) takes the frame again. The camera has no time-outs of
/// its own: the sequence has.
#[derive(Debug)]
pub struct Hm01b0<I, T, B, S> {
    i2c: I,
    delay: T,
    bus: B,
    store: S,
    configuration: Configuration,
    plan: Plan,
    readout: Option<Readout>,
}

impl<I: I2c, T: DelayNs, B: PixelBus, S: FrameStore> Hm01b0<I, T, B, S> {
    /// A camera for the frames of `plan`. The sensor is not accessed before [`begin`](Camera::begin).
    pub fn new(i2c: I, delay: T, bus: B, store: S, configuration: Configuration, plan: Plan) -> Self {
        Hm01b0 { i2c, delay, bus, store, configuration, plan, readout: None }
    }

    /// The store of the frames.
    pub fn store(&mut self) -> &mut S {
        &mut self.store
    }

    /// Gives back the buses, the delay and the store.
    pub fn release(self) -> (I, T, B, S) {
        (self.i2c, self.delay, self.bus, self.store)
    }

    fn identify(&mut self) -> Result<(), Hm01b0Error<S::Error>> {
        match sensor::read_wide(&mut self.i2c, Register::Model)? {
            sensor::MODEL => Ok(()),
            found => Err(Hm01b0Error::Model { found }),
        }
    }

    fn reset(&mut self) -> Result<(), Hm01b0Error<S::Error>> {
        sensor::write(&mut self.i2c, Register::SoftwareReset, 1)?;
        for _ in 0..RESET_POLLS {
            self.delay.delay_ms(1);
            if sensor::read(&mut self.i2c, Register::ModeSelect)? == Mode::Standby as u8 {
                return Ok(());
            }
        }
        Err(Hm01b0Error::NotReset)
    }

    fn set_mode(&mut self, mode: Mode) -> Result<(), Hm01b0Error<S::Error>> {
        Ok(sensor::write(&mut self.i2c, Register::ModeSelect, mode as u8)?)
    }

    /// Stores the lines that have arrived. Returns true if the frame is complete.
    fn store_lines(&mut self, readout: &mut Readout) -> Result<bool, Hm01b0Error<S::Error>> {
        // Bounded, in case lines arrive as fast as they are stored.
        for _ in 0..=self.configuration.size.lines() {
            match readout.receive(&mut self.bus, self.configuration.size)? {
                None => return Ok(false),
                Some(SensorOutput::Border) => {}
                Some(SensorOutput::Line(v, pixels)) => {
                    self.store.write_line(readout.frame, v, pixels).map_err(Hm01b0Error::Store)?;
                }
                Some(SensorOutput::End) => return Ok(true),
            }
        }
        Ok(false)
    }

    /// Skips the border below a streamed frame. Returns true if the frame is complete.
    fn skip_border(&mut self, readout: &mut Readout) -> Result<bool, Hm01b0Error<S::Error>> {
        let size = self.configuration.size;
        while !readout.has_ended && readout.next >= size.border() + size.height() {
            if readout.receive(&mut self.bus, size)?.is_none() {
                break;
            }
        }
        Ok(readout.has_ended)
    }

    /// Reads a line of the frame that is being streamed.
    fn streamed_line(&mut self, readout: &mut Readout, v: usize, line: &mut [u8]) -> Result<(), Hm01b0Error<S::Error>> {
        for _ in 0..=self.configuration.size.lines() {
            match readout.receive(&mut self.bus, self.configuration.size)? {
                None => return Err(Hm01b0Error::Waiting { line: v }),
                Some(SensorOutput::Border) => {}
                Some(SensorOutput::Line(number, pixels)) if number == v && pixels.len() == line.len() => {
                    line.copy_from_slice(pixels);
                    return Ok(());
                }
                Some(SensorOutput::Line(..) | SensorOutput::End) => break,
            }
        }
        Err(Hm01b0Error::NotThisLine { line: v })
    }
}

impl<I: I2c, T: DelayNs, B: PixelBus, S: FrameStore> Camera for Hm01b0<I, T, B, S> {
    type Error = Hm01b0Error<S::Error>;

    fn begin(&mut self) -> Result<(), Self::Error> {
        self.readout = None;
        self.identify()?;
        self.reset()?;
        Ok(self.configuration.write(&mut self.i2c)?)
    }

    fn start(&mut self, index: usize) -> Result<(), Self::Error> {
        self.readout = None;
        let frame = self.plan.frames().get(index).copied().ok_or(Hm01b0Error::NoFrame { index })?;
        self.set_mode(Mode::Standby)?;
        self.bus.restart();
        self.set_mode(Mode::Frames)?;
        let is_streamed = self.configuration.stream_last && index + 1 == self.plan.frames().len();
        self.readout = Some(Readout::new(frame, is_streamed));
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, Self::Error> {
        let Some(mut readout) = self.readout else { return Ok(false) };
        let complete = match readout.defect {
            Some(defect) => Err(defect.into()),
            None if readout.is_streamed => self.skip_border(&mut readout),
            None => self.store_lines(&mut readout),
        };
        self.readout = Some(readout);
        complete
    }

    fn end(&mut self) -> Result<(), Self::Error> {
        self.readout = None;
        self.bus.restart();
        self.set_mode(Mode::Standby)?;
        Ok(sensor::write(&mut self.i2c, Register::AutoExposure, 1)?)
    }
}

impl<I: I2c, T: DelayNs, B: PixelBus, S: FrameStore> ScanlineSource for Hm01b0<I, T, B, S> {
    type Error = Hm01b0Error<S::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        match self.readout {
            Some(mut readout) if readout.is_streamed && readout.frame == frame => {
                let read = self.streamed_line(&mut readout, v, line);
                self.readout = Some(readout);
                read
            }
            _ => self.store.read_line(frame, v, line).map_err(Hm01b0Error::Store),
        }
    }
}

/// A store of whole frames: internal or external memory, flash, files.
pub trait FrameStore: ScanlineSource {
    /// Stores line `v` of a frame. Lines ascend, and start again from 0 if the frame is taken again.
    ///
    /// # Errors
    /// Those of the store.
    fn write_line(&mut self, frame: Frame, v: usize, line: &[u8]) -> Result<(), Self::Error>;
}

/// Frames in memory, one after the other: the centre, then the views of the match in the order of
/// [`Views`](multiscopic_core::Views).
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Frame, Fusion, SearchConfig, Views, valid};
/// use multiscopic_drivers::hm01b0::FrameMemory;
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));
/// // Two of the three frames: the last view is matched during readout.
/// const BYTES: usize = 2 * PARAMS.width() * PARAMS.height();
///
/// let mut pixels = [0; BYTES]; // a static in firmware
/// let store = FrameMemory::new(&PARAMS, &mut pixels);
/// ```
#[derive(Debug)]
pub struct FrameMemory<'m> {
    pixels: &'m mut [u8],
    params: BlockMatchingParams,
}

impl<'m> FrameMemory<'m> {
    /// A store for frames of the size in `params`. It holds as many as fit into `pixels`, one byte a pixel.
    pub fn new(params: &BlockMatchingParams, pixels: &'m mut [u8]) -> FrameMemory<'m> {
        FrameMemory { pixels, params: *params }
    }

    fn line(&mut self, frame: Frame, v: usize) -> Result<&mut [u8], NoRoom> {
        let index = match frame {
            Frame::Center => Some(0),
            Frame::View(view) => self.params.views().iter().position(|stored| stored == view).map(|index| index + 1),
        };
        let (width, height) = (self.params.width(), self.params.height());
        let start = index.filter(|_| v < height).map(|index| (index * height + v) * width);
        start.and_then(|start| self.pixels.get_mut(start..start + width)).ok_or(NoRoom { frame, line: v })
    }
}

impl ScanlineSource for FrameMemory<'_> {
    type Error = NoRoom;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), NoRoom> {
        let stored = self.line(frame, v)?;
        line.get_mut(..stored.len()).ok_or(NoRoom { frame, line: v })?.copy_from_slice(stored);
        Ok(())
    }
}

impl Rewind for FrameMemory<'_> {
    fn rewind(&mut self) -> Result<(), NoRoom> {
        Ok(())
    }
}

impl FrameStore for FrameMemory<'_> {
    fn write_line(&mut self, frame: Frame, v: usize, line: &[u8]) -> Result<(), NoRoom> {
        let stored = self.line(frame, v)?;
        stored.copy_from_slice(line.get(..stored.len()).ok_or(NoRoom { frame, line: v })?);
        Ok(())
    }
}

/// The store has no place for a line: the frame is not part of the match, or the memory is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// The frame.
    pub frame: Frame,
    /// The line.
    pub line: usize,
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the store has no room for line {} of frame {:?}", self.line, self.frame)
    }
}

impl error::Error for NoRoom {}

/// An error that left no frame, or no line of one. `S` is the error of the frame store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hm01b0Error<S> {
    /// The I2C bus failed.
    I2c(ErrorKind),
    /// The sensor is another one, or there is none.
    Model {
        /// Its model number; an HM01B0 has 0x01b0.
        found: u16,
    },
    /// The sensor did not complete its reset within 20 ms.
    NotReset,
    /// The plan has no frame of this index.
    NoFrame {
        /// The index.
        index: usize,
    },
    /// Lines arrived faster than they were taken, and some were lost.
    Lost {
        /// The first lost line, counted from the top of the sensor, border included.
        line: usize,
    },
    /// The frame ended too early or too late.
    Torn {
        /// The number of its lines, border included.
        lines: usize,
    },
    /// A line is too short or too long, or follows the last one.
    Line {
        /// The line, counted from the top of the sensor, border included.
        line: usize,
        /// The number of its pixels.
        pixels: usize,
    },
    /// The line has not arrived yet.
    Waiting {
        /// The requested line.
        line: usize,
    },
    /// The frame is read out by the line, and another line is next; or the requested line has another width.
    NotThisLine {
        /// The requested line.
        line: usize,
    },
    /// A line could not be stored, or read from the store.
    Store(S),
}

impl<S> From<ErrorKind> for Hm01b0Error<S> {
    fn from(kind: ErrorKind) -> Self {
        Hm01b0Error::I2c(kind)
    }
}

impl<S> From<FrameDefect> for Hm01b0Error<S> {
    fn from(defect: FrameDefect) -> Self {
        match defect {
            FrameDefect::Lost { line } => Hm01b0Error::Lost { line },
            FrameDefect::Torn { lines } => Hm01b0Error::Torn { lines },
            FrameDefect::Line { line, pixels } => Hm01b0Error::Line { line, pixels },
        }
    }
}

impl<S: fmt::Display> fmt::Display for Hm01b0Error<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Hm01b0Error::I2c(kind) => write!(f, "the sensor's registers cannot be reached: {kind}"),
            Hm01b0Error::Model { found } => {
                write!(f, "the sensor is {found:#06x}, an HM01B0 is {:#06x}", sensor::MODEL)
            }
            Hm01b0Error::NotReset => f.write_str("the sensor did not complete its reset"),
            Hm01b0Error::NoFrame { index } => write!(f, "the plan has no frame {index}"),
            Hm01b0Error::Lost { line } => write!(f, "lines from {line} on came faster than they were taken"),
            Hm01b0Error::Torn { lines } => write!(f, "the frame is torn: it ended after {lines} lines"),
            Hm01b0Error::Line { line, pixels } => write!(f, "line {line} of the sensor came with {pixels} pixels"),
            Hm01b0Error::Waiting { line } => write!(f, "line {line} has not come yet"),
            Hm01b0Error::NotThisLine { line } => write!(f, "line {line} is not the next one of the sensor"),
            Hm01b0Error::Store(error) => write!(f, "{error}"),
        }
    }
}

impl<S: error::Error> error::Error for Hm01b0Error<S> {}
