//! A camera with the sensor HM01B0 of Himax.
//!
//! A low-power sensor of 324x244 grey pixels: it is set over I2C, and its pixels come over a parallel bus of 8 bits. An interrupt, or the DMA
//! that it starts, puts the lines into a [`LineQueue`], from which the camera takes them: into a [`FrameStore`], or, of the last frame of a
//! plan, straight into the matcher, while the sensor reads it out.
//!
//! ```
//! use core::time::Duration;
//! use embedded_hal::{delay::DelayNs, i2c::I2c};
//! use multiscopic_core::{
//!     Fusion, Matcher, Params, Views,
//!     capture::{Camera, Plan, Policy, Progress, Sequence, Stage},
//! };
//! use multiscopic_edge::hm01b0::{FrameMemory, Gain, Hm01b0, LineReceiver, Settings, Size};
//!
//! const PARAMS: Params = match Params::new(160, 120, Views::ALL, Fusion::Heuristic, 1, 16, 7) {
//!     Ok(params) => params,
//!     Err(_) => panic!("the parameters are out of range"),
//! };
//! const SETTINGS: Settings = Settings { exposure_lines: 60, gain: Gain::X2, ..Settings::new(Size::Qqvga) };
//!
//! /// Takes five frames, 20 mm apart, and matches them; of the last one, lines come as they are matched.
//! fn capture<S: Stage>(
//!     stage: &mut S,
//!     (i2c, delay, lines): (impl I2c, impl DelayNs, LineReceiver<'_, '_>),
//!     (frames, memory): (&mut [u8], &mut [u32]), // statics in firmware
//!     clock: impl Fn() -> Duration,
//! ) -> Option<()> {
//!     let plan = Plan::cross(PARAMS.views(), 20_000);
//!     let mut camera = Hm01b0::new(i2c, delay, lines, FrameMemory::new(&PARAMS, frames), SETTINGS, plan);
//!     let mut sequence = Sequence::new(plan.positions(), Policy::default());
//!     let (mut matcher, mut line) = (Matcher::new(&PARAMS, memory).ok()?, [None; PARAMS.width()]);
//!     loop {
//!         match sequence.poll(clock(), stage, &mut camera) {
//!             Ok(Progress::Done) => return Some(()),
//!             // Firmware may match a frame that is taken again from its first line: a new matcher does.
//!             Ok(Progress::Retrying(_)) | Err(_) => return None,
//!             Ok(Progress::Capturing(4)) => {}
//!             Ok(_) => continue,
//!         }
//!         // A line that has not come yet is asked for again the next time.
//!         if let Ok(Some(v)) = matcher.next_line(&mut camera, &mut line) {
//!             // line[u] is the disparity of pixel (u, v), if it has one.
//!         }
//!     }
//! }
//! ```

mod frame_store;
mod line_queue;
mod pixel_bus;
mod registers;
mod settings;

pub use frame_store::{FrameMemory, FrameStore, NoRoom};
pub use line_queue::{LineQueue, LineReceiver, LineSender};
pub use pixel_bus::{Arrival, PixelBus};
pub use settings::{ClockDivider, Gain, Settings, Size};

use core::{error, fmt};
use embedded_hal::{
    delay::DelayNs,
    i2c::{ErrorKind, I2c},
};
use multiscopic_core::{
    Frame, ScanlineSource,
    capture::{Camera, Plan},
};

use registers::{Mode, Register};

/// How often the sensor is asked whether it has reset itself, a millisecond apart.
const RESET_TRIES: usize = 20;

/// The camera: its registers on `I`, a delay `T`, its lines from `B`, its frames into `S`.
///
/// It is a [`ScanlineSource`] of the frames of its plan: of those that are stored, and of the last one, if that is
/// [streamed](Settings::stream_last), while it is read out. A line that has not come yet is [`Waiting`](Hm01b0Error::Waiting): ask again, as
/// [`Matcher::next_line`](multiscopic_core::Matcher::next_line) does when it is called again. The streamed frame is complete when all its
/// lines were read. The sensor must not be faster than they are: [`Settings::line_clocks`] slows it down.
///
/// A frame that is damaged, or comes too fast, is an error of [`is_complete`](Camera::is_complete), after which a
/// [`Sequence`](multiscopic_core::capture::Sequence) takes it again. That frames come at all is left to the sequence's time-outs.
#[derive(Debug)]
pub struct Hm01b0<I, T, B, S> {
    i2c: I,
    delay: T,
    bus: B,
    store: S,
    settings: Settings,
    plan: Plan,
    readout: Option<Readout>,
}

/// A frame that is being read out.
#[derive(Clone, Copy, Debug)]
struct Readout {
    frame: Frame,
    is_streamed: bool,
    /// The next line of the sensor.
    next: usize,
    has_ended: bool,
    flaw: Option<Flaw>,
}

/// What came over the bus.
enum Received<'a> {
    /// Nothing yet.
    Nothing,
    /// A line of the sensor's border.
    Border,
    /// A line of the frame.
    Line(usize, &'a [u8]),
    /// The frame's end.
    End,
}

impl<I: I2c, T: DelayNs, B: PixelBus, S: FrameStore> Hm01b0<I, T, B, S> {
    /// A camera that takes the frames of `plan`. It does nothing yet.
    pub fn new(i2c: I, delay: T, bus: B, store: S, settings: Settings, plan: Plan) -> Self {
        Hm01b0 { i2c, delay, bus, store, settings, plan, readout: None }
    }

    /// The frames that are stored.
    pub fn store(&mut self) -> &mut S {
        &mut self.store
    }

    /// Gives back what the camera was made of.
    pub fn release(self) -> (I, T, B, S) {
        (self.i2c, self.delay, self.bus, self.store)
    }

    fn identify(&mut self) -> Result<(), Hm01b0Error<S::Error>> {
        match registers::read_wide(&mut self.i2c, Register::Model)? {
            registers::MODEL => Ok(()),
            found => Err(Hm01b0Error::Model { found }),
        }
    }

    fn reset(&mut self) -> Result<(), Hm01b0Error<S::Error>> {
        registers::write(&mut self.i2c, Register::SoftwareReset, 1)?;
        for _ in 0..RESET_TRIES {
            self.delay.delay_ms(1);
            if registers::read(&mut self.i2c, Register::ModeSelect)? == Mode::Standby as u8 {
                return Ok(());
            }
        }
        Err(Hm01b0Error::NotReset)
    }

    fn set_mode(&mut self, mode: Mode) -> Result<(), Hm01b0Error<S::Error>> {
        Ok(registers::write(&mut self.i2c, Register::ModeSelect, mode as u8)?)
    }

    /// Stores the lines that have come. Whether the frame is complete.
    fn store_lines(&mut self, readout: &mut Readout) -> Result<bool, Hm01b0Error<S::Error>> {
        // At most a frame's lines, so that it does not go on for ever.
        for _ in 0..=self.settings.size.lines() {
            match readout.receive(&mut self.bus, self.settings.size)? {
                Received::Nothing => return Ok(false),
                Received::Border => {}
                Received::Line(v, pixels) => {
                    self.store.write_line(readout.frame, v, pixels).map_err(Hm01b0Error::Store)?;
                }
                Received::End => return Ok(true),
            }
        }
        Ok(false)
    }

    /// Passes the border below the lines that were read. Whether the frame is complete.
    fn pass_border(&mut self, readout: &mut Readout) -> Result<bool, Hm01b0Error<S::Error>> {
        let size = self.settings.size;
        while !readout.has_ended && readout.next >= size.border() + size.height() {
            if matches!(readout.receive(&mut self.bus, size)?, Received::Nothing) {
                break;
            }
        }
        Ok(readout.has_ended)
    }

    /// The line of a frame that is being read out.
    fn streamed_line(&mut self, readout: &mut Readout, v: usize, line: &mut [u8]) -> Result<(), Hm01b0Error<S::Error>> {
        for _ in 0..=self.settings.size.lines() {
            match readout.receive(&mut self.bus, self.settings.size)? {
                Received::Nothing => return Err(Hm01b0Error::Waiting { line: v }),
                Received::Border => {}
                Received::Line(number, pixels) if number == v && pixels.len() == line.len() => {
                    line.copy_from_slice(pixels);
                    return Ok(());
                }
                Received::Line(..) | Received::End => break,
            }
        }
        Err(Hm01b0Error::NotThisLine { line: v })
    }
}

impl Readout {
    /// Takes the next line from the bus, which must be the next one of the frame, and whole.
    fn receive<'b, B: PixelBus>(&mut self, bus: &'b mut B, size: Size) -> Result<Received<'b>, Flaw> {
        if let Some(flaw) = self.flaw {
            return Err(flaw);
        }
        if self.has_ended {
            return Ok(Received::End);
        }
        let flaw = match bus.next() {
            None => return Ok(Received::Nothing),
            Some(Arrival::Line { number, .. }) if number != self.next => Flaw::Lost { line: self.next },
            Some(Arrival::Line { number, pixels }) if pixels.len() == size.columns() && number < size.lines() => {
                self.next += 1;
                let rows = size.border()..size.border() + size.height();
                let line = pixels.get(size.border()..size.border() + size.width());
                return Ok(match line.filter(|_| rows.contains(&number)) {
                    Some(line) => Received::Line(number - rows.start, line),
                    None => Received::Border,
                });
            }
            Some(Arrival::Line { number, pixels }) => Flaw::Line { line: number, pixels: pixels.len() },
            Some(Arrival::End { lines }) if lines != size.lines() => Flaw::Torn { lines },
            Some(Arrival::End { lines }) if lines != self.next => Flaw::Lost { line: self.next },
            Some(Arrival::End { .. }) => {
                self.has_ended = true;
                return Ok(Received::End);
            }
        };
        self.flaw = Some(flaw);
        Err(flaw)
    }
}

impl<I: I2c, T: DelayNs, B: PixelBus, S: FrameStore> Camera for Hm01b0<I, T, B, S> {
    type Error = Hm01b0Error<S::Error>;

    fn begin(&mut self) -> Result<(), Self::Error> {
        self.readout = None;
        self.identify()?;
        self.reset()?;
        Ok(self.settings.write(&mut self.i2c)?)
    }

    fn start(&mut self, index: usize) -> Result<(), Self::Error> {
        self.readout = None;
        let frame = self.plan.frames().get(index).copied().ok_or(Hm01b0Error::NoFrame { index })?;
        self.set_mode(Mode::Standby)?;
        self.bus.restart();
        self.set_mode(Mode::Frames)?;
        let is_streamed = self.settings.stream_last && index + 1 == self.plan.frames().len();
        self.readout = Some(Readout { frame, is_streamed, next: 0, has_ended: false, flaw: None });
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, Self::Error> {
        let Some(mut readout) = self.readout else { return Ok(false) };
        let complete = match readout.flaw {
            Some(flaw) => Err(flaw.into()),
            None if readout.is_streamed => self.pass_border(&mut readout),
            None => self.store_lines(&mut readout),
        };
        self.readout = Some(readout);
        complete
    }

    fn end(&mut self) -> Result<(), Self::Error> {
        self.readout = None;
        self.bus.restart();
        self.set_mode(Mode::Standby)?;
        Ok(registers::write(&mut self.i2c, Register::AutoExposure, 1)?)
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

/// What is wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Flaw {
    Lost { line: usize },
    Torn { lines: usize },
    Line { line: usize, pixels: usize },
}

/// Why there is no frame, or no line of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hm01b0Error<S> {
    /// The bus of the registers failed.
    I2c(ErrorKind),
    /// The sensor is another one, or there is none.
    Model {
        /// What it says that it is; an HM01B0 says 0x01b0.
        found: u16,
    },
    /// The sensor did not reset itself within 20 ms.
    NotReset,
    /// The plan has no such frame.
    NoFrame {
        /// Its index.
        index: usize,
    },
    /// Lines came faster than they were taken, and from this one on some were lost.
    Lost {
        /// The first one, counted with the sensor's border.
        line: usize,
    },
    /// The frame ended early, or late.
    Torn {
        /// After so many lines, counted with the sensor's border.
        lines: usize,
    },
    /// A line came that is too short or too long, or after the last one.
    Line {
        /// Its number, counted with the sensor's border.
        line: usize,
        /// Its pixels.
        pixels: usize,
    },
    /// The line has not come yet.
    Waiting {
        /// The line that was asked for.
        line: usize,
    },
    /// The frame is read out line by line, and another one is next; or the line is as wide as no line of this frame.
    NotThisLine {
        /// The line that was asked for.
        line: usize,
    },
    /// The frame could not be stored, or read from the store.
    Store(S),
}

impl<S> From<ErrorKind> for Hm01b0Error<S> {
    fn from(kind: ErrorKind) -> Self {
        Hm01b0Error::I2c(kind)
    }
}

impl<S> From<Flaw> for Hm01b0Error<S> {
    fn from(flaw: Flaw) -> Self {
        match flaw {
            Flaw::Lost { line } => Hm01b0Error::Lost { line },
            Flaw::Torn { lines } => Hm01b0Error::Torn { lines },
            Flaw::Line { line, pixels } => Hm01b0Error::Line { line, pixels },
        }
    }
}

impl<S: fmt::Display> fmt::Display for Hm01b0Error<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Hm01b0Error::I2c(kind) => write!(f, "the sensor's registers cannot be reached: {kind}"),
            Hm01b0Error::Model { found } => {
                write!(f, "the sensor is {found:#06x}, an HM01B0 is {:#06x}", registers::MODEL)
            }
            Hm01b0Error::NotReset => f.write_str("the sensor does not reset itself"),
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
