//! A simulated HM01B0, which sees the frame of the place where the slide stands, and noise elsewhere; and its pixel bus: an
//! interrupt for each line, with pixels from a file or noise.

use core::cell::RefCell;
use cortex_m::{
    asm,
    interrupt::{self, Mutex},
    peripheral::SCB,
};
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use embedded_io::Read;
use multiscopic_core::{Frame, capture::Plan};
use multiscopic_drivers::hm01b0::{LineSender, Size};
use multiscopic_edge::frame_file::FrameFile;
use multiscopic_firmware::HostFile;

use super::{
    injection::{FaultKind, Injection},
    slide::Slide,
};

/// The size of the simulated frames.
pub const SIZE: Size = Size::Qqvga;
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
            send_line();
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
        begin_frame(Transmission { scene, lines, short_line, missing_line, doubled_line });
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

/// The bus, shared with the interrupt.
static BUS: Mutex<RefCell<Option<Bus>>> = Mutex::new(RefCell::new(None));

/// A frame as the bus sends it.
struct Transmission {
    /// The file of the pixels. Without one, they are noise.
    scene: Option<HostFile>,
    /// The number of lines after which the frame ends.
    lines: usize,
    /// A line that is too short.
    short_line: Option<usize>,
    /// A line of the scene that is left out.
    missing_line: Option<usize>,
    /// A line that is followed by itself.
    doubled_line: Option<usize>,
}

struct Bus {
    sender: LineSender<'static, 'static>,
    frame: Transmission,
    /// The number of the next line.
    next: usize,
    /// The last line of the scene.
    last: [u8; SIZE.width()],
    noise: u32,
}

/// Connects the bus to a line queue.
pub fn connect(sender: LineSender<'static, 'static>) {
    let frame = Transmission { scene: None, lines: 0, short_line: None, missing_line: None, doubled_line: None };
    let bus = Bus { sender, frame, next: 0, last: [0; SIZE.width()], noise: 1 };
    interrupt::free(|section| BUS.borrow(section).replace(Some(bus)));
}

/// Begins a frame.
fn begin_frame(frame: Transmission) {
    with_bus(|bus| {
        (bus.frame, bus.next) = (frame, 0);
        bus.sender.begin_frame();
    });
}

/// Sends the next line from an interrupt, as the bus of a microcontroller does.
fn send_line() {
    SCB::set_pendsv();
    // The interrupt is taken before the next instruction.
    asm::isb();
}

#[cortex_m_rt::exception]
fn PendSV() {
    with_bus(Bus::send_line);
}

fn with_bus(work: impl FnOnce(&mut Bus)) {
    interrupt::free(|section| {
        if let Some(bus) = BUS.borrow(section).borrow_mut().as_mut() {
            work(bus);
        }
    });
}

impl Bus {
    /// Sends the next line, and the end of the frame after the last one.
    fn send_line(&mut self) {
        let border = (SIZE.lines() - SIZE.height()) / 2;
        let mut pixels = [0; SIZE.width()];
        let is_inside = (border..border + SIZE.height()).contains(&self.next);
        match &mut self.frame.scene {
            Some(_) if self.next > 0 && self.frame.doubled_line == Some(self.next - 1) => pixels = self.last,
            // A file that ends early goes on as noise.
            Some(scene) if is_inside => {
                let is_read = |scene: &mut HostFile, pixels: &mut [u8]| scene.read_exact(pixels).is_ok();
                if self.frame.missing_line == Some(self.next) && !is_read(scene, &mut pixels) || !is_read(scene, &mut pixels) {
                    self.frame.scene = None;
                }
                self.last = pixels;
            }
            Some(_) => {}
            None => pixels.fill_with(|| {
                self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (self.noise >> 24) as u8
            }),
        }
        if let Some(buffer) = self.sender.buffer() {
            buffer.fill(0);
            if let Some(inside) = buffer.get_mut(border..border + SIZE.width()) {
                inside.copy_from_slice(&pixels);
            }
        }
        let is_short = self.frame.short_line == Some(self.next);
        self.sender.end_line(if is_short { SIZE.columns() / 2 } else { SIZE.columns() });
        self.next += 1;
        if self.next == self.frame.lines {
            self.sender.end_frame();
        }
    }
}
