//! A simulated HM01B0, which sees the frame of the place where the slide stands, and noise elsewhere.

use core::cell::RefCell;
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use multiscopic_core::{Frame, capture::Plan};
use multiscopic_edge::frame_file::FrameFile;
use multiscopic_firmware::HostFile;

use super::{
    injection::{FaultKind, Injection},
    simulated_bus::{self, SIZE, Transmission},
    slide::Slide,
};

/// The exposure in nanoseconds.
const EXPOSURE_NS: u64 = 20_000_000;
/// The line time in nanoseconds.
const LINE_NS: u64 = 1_000_000;
/// A sharp frame needs the slide to have stood still for this long, in nanoseconds.
const STILL_NS: u64 = 100_000_000;
/// The longest distance of the slide from the place of a frame, in steps.
const TOLERANCE: u32 = 1;
/// The distance by which a bump moves the slide, in steps.
const BUMP: i32 = 300;

const NO_RESPONSE: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data);

/// The sensor.
pub struct Sensor<'s> {
    slide: &'s RefCell<Slide>,
    plan: Plan,
    /// The places of the plan's frames, in steps from the centre.
    places: [[i32; 2]; 5],
    injection: Injection,
    /// The index of the last frame that was started, and the slide's pulses until then.
    started: Option<(usize, usize)>,
    exposure: Option<Exposure>,
    /// The address of the register that is read next.
    address: [u8; 2],
}

/// A frame that is being exposed or read out.
#[derive(Clone, Copy)]
struct Exposure {
    frame: usize,
    is_first_attempt: bool,
    /// The time of the next line.
    due: u64,
    /// The lines sent so far.
    sent: usize,
    /// The lines of the frame, known once its readout has begun.
    lines: usize,
}

impl<'s> Sensor<'s> {
    /// A sensor on a slide that moves to `places` for the frames of `plan`.
    pub fn new(slide: &'s RefCell<Slide>, plan: Plan, places: [[i32; 2]; 5]) -> Self {
        Sensor { slide, plan, places, injection: Injection::NONE, started: None, exposure: None, address: [0; 2] }
    }

    /// Injects a fault into the next frames, which are counted from 0 again.
    pub fn inject(&mut self, injection: Injection) {
        (self.injection, self.started) = (injection, None);
    }

    /// Sends the lines that are due.
    pub fn catch_up(&mut self) {
        let now = self.slide.borrow().now;
        while let Some(mut exposure) = self.exposure
            && exposure.due <= now
        {
            if self.is_hit(FaultKind::Silent, exposure) {
                self.exposure = None;
                return;
            }
            if exposure.sent == 0 {
                exposure.lines = self.begin_readout(exposure);
            }
            simulated_bus::send_line();
            exposure.sent += 1;
            exposure.due += if self.is_hit(FaultKind::Burst, exposure) { 0 } else { LINE_NS };
            self.exposure = (exposure.sent < exposure.lines).then_some(exposure);
        }
    }

    fn is_hit(&self, kind: FaultKind, exposure: Exposure) -> bool {
        self.injection.affects(kind, exposure.frame, exposure.is_first_attempt)
    }

    /// Begins the readout of a frame, and returns the number of its lines.
    fn begin_readout(&self, exposure: Exposure) -> usize {
        if self.is_hit(FaultKind::Bumped, exposure) {
            self.slide.borrow_mut().screws[0].at += BUMP;
        }
        let hit = [FaultKind::Torn, FaultKind::Missing, FaultKind::Doubled].into_iter().find(|&kind| self.is_hit(kind, exposure));
        let lines = match hit {
            Some(FaultKind::Torn) => SIZE.lines() / 2,
            Some(FaultKind::Missing) => SIZE.lines() - 1,
            Some(FaultKind::Doubled) => SIZE.lines() + 1,
            _ => SIZE.lines(),
        };
        let at = SIZE.lines() / 3;
        let short_line = self.is_hit(FaultKind::Short, exposure).then_some(at);
        let missing_line = (hit == Some(FaultKind::Missing)).then_some(at);
        let doubled_line = (hit == Some(FaultKind::Doubled)).then_some(at);
        let scene = self.frame_in_view().and_then(|frame| HostFile::open(FrameFile::new(frame).name()).ok());
        simulated_bus::begin(Transmission { scene, lines, short_line, missing_line, doubled_line });
        lines
    }

    /// The frame of the place where the slide stands, if it stands still at one.
    fn frame_in_view(&self) -> Option<Frame> {
        let slide = self.slide.borrow();
        let is_still = slide.screws.iter().all(|screw| slide.now - screw.pulsed >= STILL_NS);
        let is_at = |place: &[i32; 2]| slide.screws.iter().zip(place).all(|(screw, at)| screw.at.abs_diff(*at) <= TOLERANCE);
        let index = self.places.iter().position(is_at).filter(|_| is_still)?;
        self.plan.frames().get(index).copied()
    }

    /// Starts the next frame of the plan, or the same one again if the slide has not moved since.
    fn start(&mut self) -> Result<(), ErrorKind> {
        let pulses = self.slide.borrow().screws.iter().map(|screw| screw.pulses as usize).sum();
        let frame = match self.started {
            None => 0,
            Some((frame, at)) if at == pulses => frame,
            Some((frame, _)) => frame + 1,
        };
        let is_first_attempt = self.started.is_none_or(|(last, _)| last != frame);
        self.started = Some((frame, pulses));
        if self.injection.affects(FaultKind::NotStarted, frame, is_first_attempt) {
            return Err(NO_RESPONSE);
        }
        let due = self.slide.borrow().now + EXPOSURE_NS;
        self.exposure = Some(Exposure { frame, is_first_attempt, due, sent: 0, lines: 0 });
        Ok(())
    }

    fn write(&mut self, register: u16, value: u8) -> Result<(), ErrorKind> {
        match (register, value) {
            (0x0100, 3) => self.start(),
            (0x0100, _) => {
                self.exposure = None;
                Ok(())
            }
            (0x2100, 1) if self.injection.kind == FaultKind::Unreleased => Err(NO_RESPONSE),
            _ => Ok(()),
        }
    }

    fn read(&self, register: u16) -> u8 {
        match register {
            0x0000 if self.injection.kind == FaultKind::Model => 0x03,
            0x0000 => 0x01,
            0x0001 => 0xb0,
            _ => 0,
        }
    }
}

/// The I2C bus with the sensor's registers.
pub struct Registers<'a, 's>(pub &'a RefCell<Sensor<'s>>);

impl ErrorType for Registers<'_, '_> {
    type Error = ErrorKind;
}

impl I2c for Registers<'_, '_> {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        if address != 0x24 {
            return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
        }
        let mut sensor = self.0.borrow_mut();
        for operation in operations {
            match operation {
                &mut Operation::Write(&[high, low]) => sensor.address = [high, low],
                &mut Operation::Write(&[high, low, value]) => sensor.write(u16::from_be_bytes([high, low]), value)?,
                Operation::Read([value]) => *value = sensor.read(u16::from_be_bytes(sensor.address)),
                _ => return Err(ErrorKind::Other),
            }
        }
        Ok(())
    }
}
