//! A whole capture: the stage moves, five frames are taken from where it stands, matched while the last one is read out, and sent.
//!
//! The slide and the sensor are made up, on the other side of the pins and buses that the drivers know. It is done twice: first as the words say
//! that the firmware is started with, which is with something that goes wrong, and then as it should be. Exits with 0 if both captures
//! gave disparities, 1 if the first one did not, and 2 if the second one did not, or if the stage still moved after either.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod injection;
#[cfg(target_os = "none")]
mod simulated_sensor;
#[cfg(target_os = "none")]
#[path = "../../../drivers/tests/simulated/slide.rs"]
mod slide;

#[cfg(target_os = "none")]
mod image {
    use core::{cell::RefCell, ffi::CStr, fmt, time::Duration};
    use embedded_hal::digital::PinState;
    use embedded_io::Write;
    use multiscopic_core::{
        Disparity, MatchError, Matcher, MemoryTooSmall, Region, View,
        capture::{CaptureError, Plan, Policy, Position, Progress, Sequence, Stage},
    };
    use multiscopic_drivers::{
        hm01b0::{Configuration, FrameMemory, Hm01b0, Hm01b0Error, LineQueue, LineReceiver, NoRoom, Size},
        stepper::{Axis, Pins, Stepper, StepperError},
    };
    use multiscopic_edge::{
        Lengths, frame_file,
        packet::{BufferTooSmall, Sender},
        profile::CAPTURE,
    };
    use multiscopic_firmware::{BoardKernel, HostError, HostFile, fail};
    use semihosting::{experimental::env, process};
    use static_cell::ConstStaticCell;

    use super::{
        injection::{Fault, Kind},
        simulated_sensor::{self, Registers, Sensor},
        slide::{self, Clock, Pin, Slide},
    };

    const BASELINE_UM: u32 = 20_000;
    /// 1.6 steps per micrometre, and 30 mm to each side.
    const AXIS: Axis = Axis {
        steps: 3200,
        um: 2000,
        home_um: -31_000,
        min_um: -30_000,
        max_um: 30_000,
        release_um: 2000,
        speed_um_per_s: 20_000,
        acceleration_um_per_s2: 100_000,
        homing_um_per_s: 4000,
        forward: PinState::High,
        pressed: PinState::High,
    };
    const POLICY: Policy = Policy {
        settle: Duration::from_millis(200),
        move_timeout: Duration::from_secs(10),
        frame_timeout: Duration::from_millis(400),
        retries: 2,
        tolerance_um: 1,
        backlash_um: 1000,
        return_to_center: true,
    };
    /// How long homing may take.
    const HOMING: Duration = Duration::from_secs(60);
    /// How much of the slide's time a turn of the loop takes, in nanoseconds.
    const TURN: u64 = 1_000_000;
    /// Lines between the interrupt and the program.
    const BUFFERS: usize = 6;

    const LENGTHS: Lengths = Lengths::new::<BoardKernel>(&CAPTURE, CAPTURE.width());
    /// All but the last one.
    const STORED: usize = LAST * CAPTURE.width() * CAPTURE.height();
    /// The index of the last frame, which is matched while it is read out.
    const LAST: usize = View::ALL.len();

    static MEMORY: ConstStaticCell<[u32; LENGTHS.matcher.words()]> = ConstStaticCell::new([0; LENGTHS.matcher.words()]);
    static LINE: ConstStaticCell<[Option<Disparity>; LENGTHS.columns]> = ConstStaticCell::new([None; LENGTHS.columns]);
    static PACKET: ConstStaticCell<[u8; LENGTHS.packet]> = ConstStaticCell::new([0; LENGTHS.packet]);
    static FRAMES: ConstStaticCell<[u8; STORED]> = ConstStaticCell::new([0; STORED]);
    static QUEUE: ConstStaticCell<LineQueue<'static, { BUFFERS + 2 }>> = ConstStaticCell::new(LineQueue::new());
    static LINES: ConstStaticCell<[[u8; Size::Qqvga.columns()]; BUFFERS]> =
        ConstStaticCell::new([[0; Size::Qqvga.columns()]; BUFFERS]);

    type AxisPins<'s> = Pins<Pin<'s>, Pin<'s>, Pin<'s>, Pin<'s>>;
    type Slides<'s> = Stepper<AxisPins<'s>, AxisPins<'s>, Clock<'s>>;
    type Eye<'a, 's> = Hm01b0<Registers<'a, 's>, Clock<'s>, LineReceiver<'static, 'static>, FrameMemory<'static>>;
    type EyeError = Hm01b0Error<NoRoom>;

    /// The microcontroller, with what is connected to it.
    struct Rig<'a, 's> {
        slide: &'s RefCell<Slide>,
        sensor: &'a RefCell<Sensor<'s>>,
        stage: Slides<'s>,
        camera: Eye<'a, 's>,
    }

    /// What a match works with, and where its packets go.
    struct Desk {
        memory: &'static mut [u32],
        line: &'static mut [Option<Disparity>],
        packet: &'static mut [u8],
        path: &'static CStr,
    }

    /// Where the packets of the second capture go.
    const AGAIN: &CStr = c"again.packets";

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let Some(fault) = fault() else {
            fail("start it with: a fault, the index of a frame, and once or always");
        };
        let plan = Plan::cross(CAPTURE.views(), BASELINE_UM);
        let slide = RefCell::new(Slide::new([-40_000, 3000], [-49_601, 49_601], 31_250));
        let places = core::array::from_fn(|i| {
            let place: Position = plan.positions().get(i).copied().unwrap_or_default();
            [place.x_um, place.y_um].map(|um| um * AXIS.steps as i32 / AXIS.um as i32)
        });
        let sensor = RefCell::new(Sensor::new(&slide, plan, places));
        let (sender, lines) = QUEUE.take().split(LINES.take().iter_mut().map(|line| &mut line[..]));
        simulated_sensor::connect(sender);
        let clock = Clock(&slide);
        let stage = Stepper::new([AXIS, AXIS], slide::pins(&slide, 0), slide::pins(&slide, 1), 2000, clock);
        let stage = stage.unwrap_or_else(|error| fail(error));
        let store = FrameMemory::new(&CAPTURE, FRAMES.take());
        let camera = Hm01b0::new(Registers(&sensor), clock, lines, store, Configuration::new(Size::Qqvga), plan);
        let mut rig = Rig { slide: &slide, sensor: &sensor, stage, camera };
        let path = frame_file::PACKETS;
        let mut desk = Desk { memory: MEMORY.take(), line: LINE.take(), packet: PACKET.take(), path };

        let first = rig.capture_and_check(&mut desk, fault);
        desk.path = AGAIN;
        let second = rig.capture_and_check(&mut desk, Fault::NONE);
        process::exit(match (first, second) {
            (Some(true), Some(true)) => 0,
            (Some(false), Some(true)) => 1,
            _ => 2,
        })
    }

    /// The words that the firmware is started with; the first is its name.
    #[inline(never)]
    fn fault() -> Option<Fault> {
        let args = env::args::<128>().ok()?;
        Fault::parse((&args).into_iter().skip(1).map_while(Result::ok))
    }

    impl Rig<'_, '_> {
        /// Captures, and says how it ended: whether there are disparities; nothing if the stage does not stand still afterwards.
        fn capture_and_check(&mut self, desk: &mut Desk, fault: Fault) -> Option<bool> {
            self.inject(fault, None);
            let captured = self.capture(desk, fault);
            self.inject(Fault::NONE, None);
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

        /// Has something go wrong, from the beginning, or with the slide that is homed.
        fn inject(&mut self, fault: Fault, homed: Option<()>) {
            let mut slide = self.slide.borrow_mut();
            slide.pace = if fault.kind == Kind::Slow && homed.is_some() { 10 } else { 1 };
            for (axis, screw) in slide.screws.iter_mut().enumerate() {
                screw.fault = fault.of_axis(axis, homed.map(|()| screw.pulses));
            }
            self.sensor.borrow_mut().inject(fault);
        }

        /// A turn of the loop: time passes.
        fn turn(&mut self) {
            self.slide.borrow_mut().now += TURN;
            self.sensor.borrow_mut().catch_up();
        }

        fn now(&self) -> Duration {
            Duration::from_nanos(self.slide.borrow().now)
        }

        fn home(&mut self) -> Result<(), Failure> {
            let start = self.now();
            self.stage.home().map_err(Failure::Homing)?;
            while !self.stage.has_arrived().map_err(Failure::Homing)? {
                self.turn();
                if self.now() - start > HOMING {
                    self.stage.stop().map_err(Failure::Homing)?;
                    return Err(Failure::HomingTimeout);
                }
            }
            Ok(())
        }

        fn capture(&mut self, desk: &mut Desk, fault: Fault) -> Result<(), Failure> {
            self.home()?;
            self.inject(fault, Some(()));
            let plan = Plan::cross(CAPTURE.views(), if fault.kind == Kind::Beyond { 2 * BASELINE_UM } else { BASELINE_UM });
            let mut sequence = Sequence::new(plan.positions(), POLICY);
            let mut streams = false;
            loop {
                let progress = match streams {
                    true => self.stream(desk, &mut sequence, fault)?,
                    false => self.poll(&mut sequence, fault)?,
                };
                streams = matches!(progress, Progress::Capturing(LAST) | Progress::Retrying(LAST));
                match progress {
                    Progress::Done => break,
                    Progress::Captured(index) => defmt::info!("frame {=usize} is there", index),
                    Progress::Retrying(index) => defmt::warn!("frame {=usize} is tried again", index),
                    _ => {}
                }
            }
            self.home()?;
            match self.stage.drift() {
                [0, 0] => Ok(()),
                steps => Err(Failure::Lost { steps }),
            }
        }

        fn poll(&mut self, sequence: &mut Sequence<'_, StepperError, EyeError>, fault: Fault) -> Result<Progress, Failure> {
            self.turn();
            let progress = sequence.poll(self.now(), &mut self.stage, &mut self.camera).map_err(Failure::Capture)?;
            if fault.aborts(progress) {
                sequence.abort();
            }
            Ok(progress)
        }

        /// Matches and sends while the last frame is read out, until it is there, or is tried again.
        fn stream(
            &mut self,
            desk: &mut Desk,
            sequence: &mut Sequence<'_, StepperError, EyeError>,
            fault: Fault,
        ) -> Result<Progress, Failure> {
            // What was sent of a damaged frame is replaced. At a serial port a receiver would see packets that count from 0 again.
            let mut output = HostFile::create(desk.path).map_err(Failure::Send)?;
            let whole = Region::whole(&CAPTURE);
            let matcher = Matcher::with_isa(BoardKernel::default(), &CAPTURE, &whole, desk.memory);
            let (mut matcher, mut sender) = (matcher.map_err(Failure::Memory)?, Sender::new(&CAPTURE, desk.packet));
            let mut early = 0;
            loop {
                let progress = self.poll(sequence, fault)?;
                let is_there = progress == Progress::Captured(LAST);
                if !is_there && progress != Progress::Capturing(LAST) {
                    return Ok(progress);
                }
                // One disparity line at a time, as long as lines come; then those that need no more of them.
                loop {
                    match matcher.next_line(&mut self.camera, desk.line) {
                        Ok(Some(v)) => {
                            let packet = sender.line(&whole, v, desk.line).map_err(Failure::Packet)?;
                            output.write_all(packet).map_err(Failure::Send)?;
                        }
                        Ok(None) => break,
                        Err(error) if is_there => return Err(Failure::Match(error)),
                        // The line has not come yet, or will not: then the sequence knows.
                        Err(_) => break,
                    }
                    if !is_there {
                        early += 1;
                        break;
                    }
                }
                if is_there {
                    let stack = cortex_m_stack::stack_size() as usize - cortex_m_stack::stack_painted() as usize;
                    output.write_all(sender.end(Some(stack)).map_err(Failure::Packet)?).map_err(Failure::Send)?;
                    defmt::info!("{=usize} lines were sent while the last frame was read out", early);
                    return Ok(progress);
                }
            }
        }
    }

    /// Why there are no disparities.
    enum Failure {
        Homing(StepperError),
        HomingTimeout,
        Capture(CaptureError<StepperError, EyeError>),
        Lost { steps: [i32; 2] },
        Match(MatchError<EyeError>),
        Memory(MemoryTooSmall),
        Packet(BufferTooSmall),
        Send(HostError),
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
                Failure::Lost { steps: [x, y] } => write!(f, "the motors lost {x} and {y} steps: the frames are of no use"),
                Failure::Match(error) => write!(f, "{error}"),
                Failure::Memory(error) => write!(f, "{error}"),
                Failure::Packet(error) => write!(f, "{error}"),
                Failure::Send(error) => write!(f, "cannot send a disparity line: {error}"),
            }
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
