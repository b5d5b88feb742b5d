//! A sensor that sees files: those of the place where the slide stands, and noise elsewhere.

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
use multiscopic_edge::frame_file;
use multiscopic_firmware::HostFile;

use super::{
    injection::{Fault, Kind},
    slide::Slide,
};

const SIZE: Size = Size::Qqvga;
/// Nanoseconds of exposure, and of a line.
const EXPOSURE: u64 = 20_000_000;
const LINE: u64 = 1_000_000;
/// How long the slide must have stood still, in nanoseconds.
const STILL: u64 = 100_000_000;
/// How far it may be off, in steps.
const OFF: u32 = 1;
/// How far somebody moves it, in steps.
const BUMP: i32 = 300;

/// What the interrupt of the pixel bus works with.
static BUS: Mutex<RefCell<Option<Bus>>> = Mutex::new(RefCell::new(None));

/// The bus, as the interrupt sees it.
pub struct Bus {
    lines: LineSender<'static, 'static>,
    /// Where the pixels come from; without, they are noise.
    scene: Option<HostFile>,
    /// The next line.
    next: usize,
    /// After which line the frame ends, and which is too short.
    ends: usize,
    short: Option<usize>,
    noise: u32,
}

/// Connects the bus to a queue.
pub fn connect(lines: LineSender<'static, 'static>) {
    let bus = Bus { lines, scene: None, next: 0, ends: 0, short: None, noise: 1 };
    interrupt::free(|section| BUS.borrow(section).replace(Some(bus)));
}

/// The interrupt: a line has come.
#[cortex_m_rt::exception]
fn PendSV() {
    interrupt::free(|section| {
        if let Some(bus) = BUS.borrow(section).borrow_mut().as_mut() {
            bus.line();
        }
    });
}

impl Bus {
    fn begin(&mut self, scene: Option<HostFile>, ends: usize, short: Option<usize>) {
        (self.scene, self.next, self.ends, self.short) = (scene, 0, ends, short);
        self.lines.begin_frame();
    }

    /// Sends the next line, and after the last one the frame's end.
    fn line(&mut self) {
        let border = (SIZE.lines() - SIZE.height()) / 2;
        let mut pixels = [0; SIZE.width()];
        let is_inside = (border..border + SIZE.height()).contains(&self.next);
        match &mut self.scene {
            Some(scene) if is_inside => self.scene = scene.read_exact(&mut pixels).is_ok().then(|| self.scene.take()).flatten(),
            Some(_) => {}
            None => pixels.fill_with(|| {
                self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (self.noise >> 24) as u8
            }),
        }
        if let Some(buffer) = self.lines.buffer() {
            buffer.fill(0);
            if let Some(inside) = buffer.get_mut(border..border + SIZE.width()) {
                inside.copy_from_slice(&pixels);
            }
        }
        let columns = if self.short == Some(self.next) { SIZE.columns() / 2 } else { SIZE.columns() };
        self.lines.end_line(columns);
        self.next += 1;
        if self.next == self.ends {
            self.lines.end_frame();
        }
    }
}

/// The sensor.
pub struct Sensor<'s> {
    slide: &'s RefCell<Slide>,
    plan: Plan,
    /// The places of the frames, in steps from the centre.
    places: [[i32; 2]; 5],
    fault: Fault,
    /// How many frames were started, and how often the last one.
    taken: Option<(usize, usize)>,
    shot: Option<Shot>,
    registers: [u8; 2],
}

/// A frame that is taken.
#[derive(Clone, Copy)]
struct Shot {
    frame: usize,
    is_first: bool,
    /// When the next line comes, and how many have come.
    due: u64,
    lines: usize,
    /// After how many it ends.
    ends: usize,
}

impl<'s> Sensor<'s> {
    /// A sensor on a slide that moves to so many steps for the frames of a plan.
    pub fn new(slide: &'s RefCell<Slide>, plan: Plan, places: [[i32; 2]; 5]) -> Self {
        Sensor { slide, plan, places, fault: Fault::NONE, taken: None, shot: None, registers: [0; 2] }
    }

    /// What goes wrong with the frames that follow, which are counted from 0 again.
    pub fn inject(&mut self, fault: Fault) {
        (self.fault, self.taken) = (fault, None);
    }

    /// Sends the lines whose time has come.
    pub fn catch_up(&mut self) {
        let now = self.slide.borrow().now;
        while let Some(mut shot) = self.shot
            && shot.due <= now
        {
            if self.fault.hits(Kind::Silent, shot.frame, shot.is_first) {
                self.shot = None;
                return;
            }
            if shot.lines == 0 {
                shot.ends = self.begin(shot);
            }
            // The bus of a microcontroller interrupts the program; so does this.
            SCB::set_pendsv();
            asm::isb();
            shot.lines += 1;
            shot.due += if self.fault.hits(Kind::Burst, shot.frame, shot.is_first) { 0 } else { LINE };
            self.shot = (shot.lines < shot.ends).then_some(shot);
        }
    }

    /// Begins to read out a frame, and says how many lines it has.
    fn begin(&self, shot: Shot) -> usize {
        if self.fault.hits(Kind::Bumped, shot.frame, shot.is_first) {
            self.slide.borrow_mut().screws[0].at += BUMP;
        }
        let ends = if self.fault.hits(Kind::Torn, shot.frame, shot.is_first) { SIZE.lines() / 2 } else { SIZE.lines() };
        let short = self.fault.hits(Kind::Short, shot.frame, shot.is_first).then_some(SIZE.lines() / 3);
        let scene = self.seen().and_then(|frame| HostFile::open(frame_file::name(frame)).ok());
        interrupt::free(|section| {
            if let Some(bus) = BUS.borrow(section).borrow_mut().as_mut() {
                bus.begin(scene, ends, short);
            }
        });
        ends
    }

    /// The frame that is seen from where the slide stands, if it stands still.
    fn seen(&self) -> Option<Frame> {
        let slide = self.slide.borrow();
        let is_still = slide.screws.iter().all(|screw| slide.now - screw.pulsed >= STILL);
        let is_at = |place: &[i32; 2]| slide.screws.iter().zip(place).all(|(screw, at)| screw.at.abs_diff(*at) <= OFF);
        let seen = self.places.iter().position(is_at).filter(|_| is_still)?;
        self.plan.frames().get(seen).copied()
    }

    /// The frame of the plan that the slide was sent to, whether or not it is there.
    fn start(&mut self) -> Result<(), ErrorKind> {
        // A frame that is taken again comes from where the last one did.
        let place = self.slide.borrow().screws.each_ref().map(|screw| screw.pulses as usize);
        let pulses = place[0] + place[1];
        let frame = match self.taken {
            None => 0,
            Some((frame, at)) if at == pulses => frame,
            Some((frame, _)) => frame + 1,
        };
        let is_first = self.taken.is_none_or(|(last, _)| last != frame);
        self.taken = Some((frame, pulses));
        if self.fault.hits(Kind::NotStarted, frame, is_first) {
            return Err(NO_ANSWER);
        }
        let due = self.slide.borrow().now + EXPOSURE;
        self.shot = Some(Shot { frame, is_first, due, lines: 0, ends: 0 });
        Ok(())
    }

    fn write(&mut self, register: u16, value: u8) -> Result<(), ErrorKind> {
        match (register, value) {
            (0x0100, 3) => self.start(),
            (0x0100, _) => {
                self.shot = None;
                Ok(())
            }
            (0x2100, 1) if self.fault.kind == Kind::Unreleased => Err(NO_ANSWER),
            _ => Ok(()),
        }
    }

    fn read(&self, register: u16) -> u8 {
        match register {
            0x0000 if self.fault.kind == Kind::Model => 0x03,
            0x0000 => 0x01,
            0x0001 => 0xb0,
            _ => 0,
        }
    }
}

const NO_ANSWER: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data);

/// The bus of the sensor's registers.
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
                &mut Operation::Write(&[high, low]) => sensor.registers = [high, low],
                &mut Operation::Write(&[high, low, value]) => sensor.write(u16::from_be_bytes([high, low]), value)?,
                Operation::Read([value]) => *value = sensor.read(u16::from_be_bytes(sensor.registers)),
                _ => return Err(ErrorKind::Other),
            }
        }
        Ok(())
    }
}
