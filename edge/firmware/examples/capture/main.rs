//! A complete capture: the stage moves, the camera takes five frames, and the firmware matches them during
//! the readout of the last one and sends the disparities.
//!
//! The slide and the sensor are simulated, on the other side of the pins and buses that the drivers use. The
//! capture runs twice: first with the fault on the command line, then without. Exit codes: 0 if both captures
//! gave disparities, 1 if the first did not, 2 if the second did not, or if the stage still moved after
//! either.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod injection;
#[cfg(target_os = "none")]
mod simulated_sensor;
// Shared with the tests of the drivers.
#[cfg(target_os = "none")]
#[path = "../../../drivers/tests/simulated/slide.rs"]
mod slide;
#[cfg(target_os = "none")]
mod testbench;

#[cfg(target_os = "none")]
mod image {
    use core::{cell::RefCell, ffi::CStr};
    use embedded_hal::digital::PinState;
    use multiscopic_core::{
        Disparity,
        capture::{Plan, Position},
    };
    use multiscopic_drivers::{
        hm01b0::{Configuration, FrameMemory, Hm01b0, LineQueue},
        stepper::{Axis, Stepper},
    };
    use multiscopic_edge::{Lengths, Matching, frame_file, profile::CAPTURE};
    use multiscopic_firmware::fail;
    use semihosting::{experimental::env, process};
    use static_cell::ConstStaticCell;

    use super::{
        injection::Injection,
        simulated_sensor::{self, Registers, SIZE, Sensor},
        slide::{self, Clock, Slide},
        testbench::{BASELINE_UM, LAST, MatchBuffers, Testbench},
    };

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
    /// The number of line buffers between the interrupt and the program.
    const LINE_BUFFERS: usize = 6;
    const LENGTHS: Lengths = Matching::Blocks { params: CAPTURE, tile_width: CAPTURE.width() }.lengths();
    /// Every frame but the last one is stored.
    const STORED_BYTES: usize = LAST * CAPTURE.width() * CAPTURE.height();

    static MEMORY: ConstStaticCell<[u32; LENGTHS.matcher.words()]> = ConstStaticCell::new([0; LENGTHS.matcher.words()]);
    static LINE: ConstStaticCell<[Option<Disparity>; LENGTHS.columns]> = ConstStaticCell::new([None; LENGTHS.columns]);
    static PACKET: ConstStaticCell<[u8; LENGTHS.packet]> = ConstStaticCell::new([0; LENGTHS.packet]);
    static FRAMES: ConstStaticCell<[u8; STORED_BYTES]> = ConstStaticCell::new([0; STORED_BYTES]);
    static QUEUE: ConstStaticCell<LineQueue<'static, { LINE_BUFFERS + 2 }>> = ConstStaticCell::new(LineQueue::new());
    static LINES: ConstStaticCell<[[u8; SIZE.columns()]; LINE_BUFFERS]> =
        ConstStaticCell::new([[0; SIZE.columns()]; LINE_BUFFERS]);

    /// The packets of the second capture.
    const SECOND_PACKETS: &CStr = c"again.packets";

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let Some(injection) = injection() else {
            fail("start it with: a fault, the index of a frame, and once or always");
        };
        let plan = Plan::new(CAPTURE.views(), BASELINE_UM);
        let slide = RefCell::new(Slide::new([-40_000, 3000], [-49_601, 49_601], 31_250));
        let places = core::array::from_fn(|i| {
            let place: Position = plan.positions().get(i).copied().unwrap_or_default();
            [place.x_um, place.y_um].map(|um| um * AXIS.steps as i32 / AXIS.um as i32)
        });
        let sensor = RefCell::new(Sensor::new(&slide, plan, places));
        let (sender, receiver) = QUEUE.take().split(LINES.take().iter_mut().map(|line| &mut line[..]));
        simulated_sensor::connect(sender);
        let clock = Clock(&slide);
        let stage = Stepper::new([AXIS, AXIS], slide::pins(&slide, 0), slide::pins(&slide, 1), 2000, clock);
        let stage = stage.unwrap_or_else(|error| fail(error));
        let store = FrameMemory::new(&CAPTURE, FRAMES.take());
        let camera = Hm01b0::new(Registers(&sensor), clock, receiver, store, Configuration::new(SIZE), plan);
        let mut testbench = Testbench { slide: &slide, sensor: &sensor, stage, camera };
        let path = frame_file::PACKETS;
        let mut buffers = MatchBuffers { memory: MEMORY.take(), line: LINE.take(), packet: PACKET.take(), path };

        let first = testbench.capture_and_check(&mut buffers, injection);
        buffers.path = SECOND_PACKETS;
        let second = testbench.capture_and_check(&mut buffers, Injection::NONE);
        process::exit(match (first, second) {
            (Some(true), Some(true)) => 0,
            (Some(false), Some(true)) => 1,
            _ => 2,
        })
    }

    /// The fault on the command line, whose first word is the name of the program.
    #[inline(never)]
    fn injection() -> Option<Injection> {
        let args = env::args::<128>().ok()?;
        Injection::parse((&args).into_iter().skip(1).map_while(Result::ok))
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
