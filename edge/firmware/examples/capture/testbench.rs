//! The drivers under test on simulated hardware: captures, matches and sends.

use core::{cell::RefCell, ffi::CStr, fmt, time::Duration};
use embedded_io::Write;
use multiscopic_core::{
    BlockMatchingParams, Disparity, MatchError, Matcher, MemoryTooSmall, Region, View,
    capture::{CaptureError, CaptureProgress, Plan, Policy, Sequence, Stage},
};
use multiscopic_drivers::{
    hm01b0::{FrameMemory, Hm01b0, Hm01b0Error, LineReceiver, NoRoom},
    stepper::{Pins, Stepper, StepperError},
};
use multiscopic_edge::{
    packet::{BufferTooSmall, Sender},
    profile::CAPTURE,
};
use multiscopic_firmware::{HostError, HostFile};

use super::{
    injection::{FaultKind, Injection},
    simulated_sensor::{Registers, Sensor},
    slide::{Clock, Pin, Slide},
};

multiscopic_core::params!(
    /// The match, whose code alone is linked.
    CaptureMatch: BlockMatchingParams = Ok(CAPTURE)
);

/// The baseline in micrometres.
pub const BASELINE_UM: u32 = 20_000;
/// The index of the last frame, which is matched during readout.
pub const LAST: usize = View::CROSS.len();

const POLICY: Policy = Policy {
    settle: Duration::from_millis(200),
    move_timeout: Duration::from_secs(10),
    frame_timeout: Duration::from_millis(400),
    retries: 2,
    tolerance_um: 1,
    backlash_um: 1000,
    return_to_center: true,
};
/// The longest time of homing.
const HOMING_TIMEOUT: Duration = Duration::from_secs(60);
/// The time of one turn of the main loop, in nanoseconds.
const TURN_NS: u64 = 1_000_000;

type AxisPins<'s> = Pins<Pin<'s>, Pin<'s>, Pin<'s>, Pin<'s>>;
type SlideStage<'s> = Stepper<AxisPins<'s>, AxisPins<'s>, Clock<'s>>;
type SensorCamera<'a, 's> = Hm01b0<Registers<'a, 's>, Clock<'s>, LineReceiver<'static, 'static>, FrameMemory<'static>>;

/// The stage and the camera, and the simulated hardware behind them.
pub struct Testbench<'a, 's> {
    pub slide: &'s RefCell<Slide>,
    pub sensor: &'a RefCell<Sensor<'s>>,
    pub stage: SlideStage<'s>,
    pub camera: SensorCamera<'a, 's>,
}

/// The buffers of a match, and the file of its packets.
pub struct MatchBuffers {
    pub memory: &'static mut [u32],
    pub line: &'static mut [Option<Disparity>],
    pub packet: &'static mut [u8],
    pub path: &'static CStr,
}

impl Testbench<'_, '_> {
    /// Captures with a fault. Returns true if that gave disparities, and `None` if the stage did not stop.
    pub fn capture_and_check(&mut self, buffers: &mut MatchBuffers, injection: Injection) -> Option<bool> {
        self.inject(injection, false);
        let captured = self.capture(buffers, injection);
        self.inject(Injection::NONE, false);
        match &captured {
            Ok(()) => defmt::info!("captured, matched and sent"),
            Err(failure) => defmt::error!("{}", defmt::Display2Format(failure)),
        }
        let pulses = |slide: &RefCell<Slide>| slide.borrow().screws.each_ref().map(|screw| screw.pulses);
        let before = pulses(self.slide);
        for _ in 0..1000 {
            let _ = self.stage.has_arrived();
            self.turn();
        }
        if pulses(self.slide) == before {
            return Some(captured.is_ok());
        }
        defmt::error!("the stage still moves");
        None
    }

    /// Injects a fault into the slide and the sensor.
    fn inject(&mut self, injection: Injection, is_homed: bool) {
        let mut slide = self.slide.borrow_mut();
        slide.slowdown = if injection.kind == FaultKind::Slow && is_homed { 10 } else { 1 };
        for (axis, screw) in slide.screws.iter_mut().enumerate() {
            screw.fault = injection.of_screw(axis, is_homed.then_some(screw.pulses));
        }
        self.sensor.borrow_mut().inject(injection);
    }

    /// A turn of the main loop: time passes, and lines arrive.
    fn turn(&mut self) {
        self.slide.borrow_mut().now += TURN_NS;
        self.sensor.borrow_mut().catch_up();
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.slide.borrow().now)
    }

    fn home(&mut self) -> Result<(), CaptureFailure> {
        let start = self.now();
        self.stage.home().map_err(CaptureFailure::Homing)?;
        while !self.stage.has_arrived().map_err(CaptureFailure::Homing)? {
            self.turn();
            if self.now() - start > HOMING_TIMEOUT {
                self.stage.stop().map_err(CaptureFailure::Homing)?;
                return Err(CaptureFailure::HomingTimeout);
            }
        }
        Ok(())
    }

    fn capture(&mut self, buffers: &mut MatchBuffers, injection: Injection) -> Result<(), CaptureFailure> {
        self.home()?;
        self.inject(injection, true);
        let baseline_um = if injection.kind == FaultKind::Beyond { 2 * BASELINE_UM } else { BASELINE_UM };
        let plan = Plan::new(CAPTURE.views(), baseline_um);
        let mut sequence = Sequence::new(plan.positions(), POLICY);
        let mut is_streaming = false;
        loop {
            let progress = match is_streaming {
                true => self.match_last_frame(buffers, &mut sequence, injection)?,
                false => self.poll(&mut sequence, injection)?,
            };
            is_streaming = matches!(progress, CaptureProgress::Capturing(LAST) | CaptureProgress::Retrying(LAST));
            match progress {
                CaptureProgress::Done => break,
                CaptureProgress::Captured(index) => defmt::info!("frame {=usize} is there", index),
                CaptureProgress::Retrying(index) => defmt::warn!("frame {=usize} is tried again", index),
                _ => {}
            }
        }
        // Homing again shows whether the motors lost steps.
        self.home()?;
        match self.stage.drift() {
            [0, 0] => Ok(()),
            steps => Err(CaptureFailure::StepsLost { steps }),
        }
    }

    fn poll(
        &mut self,
        sequence: &mut Sequence<'_, StepperError, CameraError>,
        injection: Injection,
    ) -> Result<CaptureProgress, CaptureFailure> {
        self.turn();
        let progress = sequence.poll(self.now(), &mut self.stage, &mut self.camera).map_err(CaptureFailure::Capture)?;
        if injection.aborts(progress) {
            sequence.abort();
        }
        Ok(progress)
    }

    /// Matches and sends during the readout of the last frame, until the frame is complete or tried again.
    fn match_last_frame(
        &mut self,
        buffers: &mut MatchBuffers,
        sequence: &mut Sequence<'_, StepperError, CameraError>,
        injection: Injection,
    ) -> Result<CaptureProgress, CaptureFailure> {
        // Replaces the packets of a damaged frame. On a serial port, a receiver would see them count from 0
        // again.
        let mut output = HostFile::create(buffers.path).map_err(CaptureFailure::Send)?;
        let whole = Region::whole(CAPTURE.search());
        let matcher = Matcher::new(&CaptureMatch, buffers.memory);
        let (mut matcher, mut sender) = (matcher.map_err(CaptureFailure::Memory)?, Sender::new(CAPTURE.search(), buffers.packet));
        let mut lines_during_readout = 0;
        loop {
            let progress = self.poll(sequence, injection)?;
            let is_complete = progress == CaptureProgress::Captured(LAST);
            if !is_complete && progress != CaptureProgress::Capturing(LAST) {
                return Ok(progress);
            }
            // During readout one disparity line a turn, as lines arrive; afterwards all that remain.
            loop {
                match matcher.next_line(&mut self.camera, buffers.line) {
                    Ok(Some(v)) => {
                        let packet = sender.line(&whole, v, buffers.line).map_err(CaptureFailure::Packet)?;
                        output.write_all(packet).map_err(CaptureFailure::Send)?;
                    }
                    Ok(None) => break,
                    Err(error) if is_complete => return Err(CaptureFailure::Match(error)),
                    // The line has not arrived yet. If it never does, the sequence reports it.
                    Err(_) => break,
                }
                if !is_complete {
                    lines_during_readout += 1;
                    break;
                }
            }
            if is_complete {
                let stack = multiscopic_firmware::stack_depth();
                let end = sender.end(Some(stack)).map_err(CaptureFailure::Packet)?;
                output.write_all(end).map_err(CaptureFailure::Send)?;
                defmt::info!("{=usize} lines were sent while the last frame was read out", lines_during_readout);
                return Ok(progress);
            }
        }
    }
}

/// The error of the camera.
type CameraError = Hm01b0Error<NoRoom>;

/// An error that left a capture without disparities.
enum CaptureFailure {
    Homing(StepperError),
    HomingTimeout,
    Capture(CaptureError<StepperError, CameraError>),
    StepsLost { steps: [i32; 2] },
    Match(MatchError<CameraError>),
    Memory(MemoryTooSmall),
    Packet(BufferTooSmall),
    Send(HostError),
}

impl fmt::Display for CaptureFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CaptureFailure::Homing(error) => write!(f, "homing: {error}"),
            CaptureFailure::HomingTimeout => write!(f, "homing took too long"),
            CaptureFailure::Capture(error) => {
                error.index().map_or(Ok(()), |index| write!(f, "frame {index}: "))?;
                write!(f, "{error}")
            }
            CaptureFailure::StepsLost { steps: [x, y] } => {
                write!(f, "the motors lost {x} and {y} steps: the frames are of no use")
            }
            CaptureFailure::Match(error) => write!(f, "{error}"),
            CaptureFailure::Memory(error) => write!(f, "{error}"),
            CaptureFailure::Packet(error) => write!(f, "{error}"),
            CaptureFailure::Send(error) => write!(f, "cannot send a disparity line: {error}"),
        }
    }
}
