//! The slide with the camera: captures, matches and sends.

use core::{fmt, time::Duration};
use embassy_rp::{
    gpio::{Input, Output},
    i2c::{Blocking, I2c},
    peripherals::I2C0,
    watchdog::Watchdog,
};
use embassy_time::{Delay, Instant};
use embedded_io::Write;
use multiscopic_core::{
    Disparity, MatchError, Matcher, MemoryTooSmall, Region,
    capture::{CaptureError, CaptureProgress, Plan, Sequence, Stage},
    kernel::Native,
};
use multiscopic_drivers::{
    hm01b0::{FrameMemory, Hm01b0, Hm01b0Error, LineReceiver, NoRoom},
    stepper::{Pins, Stepper, StepperError},
};
use multiscopic_edge::packet::{BufferTooSmall, Sender};

use crate::{
    mechanics::{HOMING_TIMEOUT, Match, POLICY, TILE_WIDTH},
    packet_port::{self, PacketPort, PortError},
};

/// The time without progress after which the watchdog restarts the chip.
const WATCHDOG: embassy_time::Duration = embassy_time::Duration::from_secs(4);
/// The time between the opening of the port and the capture.
const AFTER_OPENING: Duration = Duration::from_millis(300);
/// The time between a failure and the next try.
const AFTER_FAILURE: Duration = Duration::from_secs(5);

/// The pins of an axis.
pub type AxisPins = Pins<Output<'static>, Output<'static>, Input<'static>, Input<'static>>;
/// The slide.
pub type Slide = Stepper<AxisPins, AxisPins, Delay>;
/// The camera.
pub type SlideCamera = Hm01b0<I2c<'static, I2C0, Blocking>, Delay, LineReceiver<'static, 'static>, FrameMemory<'static>>;

/// The slide with the camera.
pub struct Rig {
    /// The slide.
    pub stage: Slide,
    /// The camera.
    pub camera: SlideCamera,
    /// The enable input of both motor drivers, which is active low.
    pub disable_motors: Output<'static>,
    /// The chip's watchdog. It is fed by progress alone: a step of the capture or a line that was sent.
    pub watchdog: Watchdog,
    /// The memory of the match.
    pub buffers: MatchBuffers,
}

/// The memory of a match.
pub struct MatchBuffers {
    /// The matcher's.
    pub memory: &'static mut [u32],
    /// A line of disparities.
    pub line: &'static mut [Option<Disparity>],
    /// A packet.
    pub packet: &'static mut [u8],
}

impl Rig {
    /// Captures, matches and sends once whenever a program on the host opens the port.
    pub fn run(&mut self, plan: &Plan) -> ! {
        self.watchdog.start(WATCHDOG);
        loop {
            self.wait_for_reader();
            match self.capture_and_send(plan) {
                Ok(()) => {
                    defmt::info!("captured, matched and sent");
                    self.wait_while(packet_port::is_open);
                }
                Err(failure) => {
                    defmt::error!("{}", defmt::Display2Format(&failure));
                    let start = now();
                    self.wait_while(|| now() - start < AFTER_FAILURE);
                }
            }
        }
    }

    fn capture_and_send(&mut self, plan: &Plan) -> Result<(), Failure> {
        self.disable_motors.set_low();
        let captured = self.capture(plan);
        self.disable_motors.set_high();
        captured?;
        let start = now();
        self.match_and_send()?;
        defmt::info!("matched in {=u64} ms", (now() - start).as_millis() as u64);
        Ok(())
    }

    /// Takes all frames.
    fn capture(&mut self, plan: &Plan) -> Result<(), Failure> {
        self.home()?;
        let mut sequence = Sequence::new(plan.positions(), POLICY);
        loop {
            // It has a time-out for each step.
            match sequence.poll(now(), &mut self.stage, &mut self.camera).map_err(Failure::Capture)? {
                CaptureProgress::Done => break,
                CaptureProgress::Captured(index) => defmt::info!("frame {=usize} is there", index),
                CaptureProgress::Retrying(index) => defmt::warn!("frame {=usize} is tried again", index),
                _ => {}
            }
            self.watchdog.feed(WATCHDOG);
        }
        // Homing again shows whether the motors lost steps.
        self.home()?;
        match self.stage.drift() {
            [0, 0] => Ok(()),
            steps => Err(Failure::StepsLost(steps)),
        }
    }

    fn home(&mut self) -> Result<(), Failure> {
        let start = now();
        self.stage.home().map_err(Failure::Homing)?;
        while !self.stage.has_arrived().map_err(Failure::Homing)? {
            self.watchdog.feed(WATCHDOG);
            if now() - start > HOMING_TIMEOUT {
                self.stage.stop().map_err(Failure::Homing)?;
                return Err(Failure::HomingTimeout);
            }
        }
        Ok(())
    }

    /// Matches the frames, column tile by column tile, and sends each line as soon as it is known.
    fn match_and_send(&mut self) -> Result<(), Failure> {
        let MatchBuffers { memory, line, packet } = &mut self.buffers;
        let mut sender = Sender::new(Match::PARAMS.search(), packet);
        for tile in Region::tiles(Match::PARAMS.search(), TILE_WIDTH) {
            let mut matcher = Matcher::with_isa(Native::default(), &Match, &tile, memory).map_err(Failure::Memory)?;
            let line = &mut line[..tile.width()];
            while let Some(v) = matcher.next_line(self.camera.store(), line).map_err(Failure::Match)? {
                let packet = sender.line(&tile, v, line).map_err(Failure::Packet)?;
                PacketPort.write_all(packet).map_err(Failure::Send)?;
                self.watchdog.feed(WATCHDOG);
            }
        }
        PacketPort.write_all(sender.end(None).map_err(Failure::Packet)?).map_err(Failure::Send)?;
        PacketPort.flush().map_err(Failure::Send)
    }

    /// Waits until a program has had the port open for a moment. Programs that only set it up close it again at once.
    fn wait_for_reader(&mut self) {
        while !packet_port::is_open() {
            self.wait_while(|| !packet_port::is_open());
            let start = now();
            self.wait_while(|| packet_port::is_open() && now() - start < AFTER_OPENING);
        }
    }

    /// Waits, which is all that there is to do.
    fn wait_while(&mut self, condition: impl Fn() -> bool) {
        while condition() {
            self.watchdog.feed(WATCHDOG);
        }
    }
}

/// The time since the start.
fn now() -> Duration {
    Duration::from_micros(Instant::now().as_micros())
}

/// An error that left a capture without disparities.
enum Failure {
    /// The slide does not find its switches.
    Homing(StepperError),
    /// Homing took too long.
    HomingTimeout,
    /// The stage or the camera failed.
    Capture(CaptureError<StepperError, Hm01b0Error<NoRoom>>),
    /// Homing again did not find the switches where they were.
    StepsLost([i32; 2]),
    /// A frame is not in memory.
    Match(MatchError<NoRoom>),
    /// The matcher's memory is too small.
    Memory(MemoryTooSmall),
    /// The packet's buffer is too small.
    Packet(BufferTooSmall),
    /// A packet was not sent.
    Send(PortError),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Homing(error) => write!(f, "homing: {error}"),
            Failure::HomingTimeout => write!(f, "homing took too long"),
            Failure::Capture(error) => {
                error.index().map_or(Ok(()), |index| write!(f, "frame {index}: "))?;
                write!(f, "{error}")
            }
            Failure::StepsLost([x, y]) => write!(f, "the motors lost {x} and {y} steps: the frames are of no use"),
            Failure::Match(error) => write!(f, "{error}"),
            Failure::Memory(error) => write!(f, "{error}"),
            Failure::Packet(error) => write!(f, "{error}"),
            Failure::Send(error) => write!(f, "cannot send a packet: {error}"),
        }
    }
}
