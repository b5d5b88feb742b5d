//! Firmware for a Raspberry Pi Pico 2 with a camera HM01B0 on a slide with two stepping motors.
//!
//! Whenever a program opens the serial port that it is on USB, the slide homes and takes the camera to five places, and
//! the disparities of the five frames go out through the port. README.md beside it has the wiring.
//!
//! | module | what it is |
//! | --- | --- |
//! | `mechanics` | the slide, the camera's settings, and the match: what to change for another slide |
//! | `pixel_port` | lines from the sensor's pixel bus, by a state machine (`lines.pio`) and DMA |
//! | `line_format` | the bytes of those lines |
//! | `packet_port` | the serial port on USB |
//! | `software_interrupts` | the interrupts that receive lines and send packets beside the program |
//! | `rig` | captures, matches and sends |
#![no_std]
#![no_main]

mod line_format;
mod mechanics;
mod packet_port;
mod pixel_port;
mod rig;

use defmt_rtt as _; // Sends the log to the probe.
use embassy_rp::{
    Peri, bind_interrupts,
    clocks::{Gpout, GpoutSrc},
    dma,
    gpio::{Input, Level, Output, Pin, Pull},
    i2c::{self, I2c},
    interrupt::{self, InterruptExt, Priority},
    peripherals::{DMA_CH0, PIO0, USB},
    pio, usb,
    watchdog::Watchdog,
};
use embassy_time::Delay;
use multiscopic_core::{Disparity, capture::Plan};
use multiscopic_drivers::{
    hm01b0::{FrameMemory, Hm01b0, LineQueue},
    stepper::{Pins, Stepper},
};
use panic_probe as _; // Logs the panic and stops. The watchdog then restarts the chip.
use static_cell::ConstStaticCell;

use mechanics::{AXIS, BASELINE_UM, CONFIGURATION, LENGTHS, Match, PULSE_NS};
use pixel_port::{PixelPins, PixelPort};
use rig::{MatchBuffers, Rig};

bind_interrupts!(struct Interrupts {
    DMA_IRQ_0 => dma::InterruptHandler<DMA_CH0>;
    PIO0_IRQ_0 => pio::InterruptHandler<PIO0>;
    USBCTRL_IRQ => usb::InterruptHandler<USB>;
});

/// The line buffers between the sensor and the program.
const LINE_BUFFERS: usize = 6;
const COLUMNS: usize = CONFIGURATION.size.columns();
/// The centre and the views. All are stored, since each column tile reads all of them.
const FRAME_BYTES: usize = (1 + Match::PARAMS.views().len()) * Match::PARAMS.width() * Match::PARAMS.height();

static FRAMES: ConstStaticCell<[u8; FRAME_BYTES]> = ConstStaticCell::new([0; FRAME_BYTES]);
static MEMORY: ConstStaticCell<[u32; LENGTHS.matcher.words()]> = ConstStaticCell::new([0; LENGTHS.matcher.words()]);
static LINE: ConstStaticCell<[Option<Disparity>; LENGTHS.columns]> = ConstStaticCell::new([None; LENGTHS.columns]);
static PACKET: ConstStaticCell<[u8; LENGTHS.packet]> = ConstStaticCell::new([0; LENGTHS.packet]);
static QUEUE: ConstStaticCell<LineQueue<'static, { LINE_BUFFERS + 2 }>> = ConstStaticCell::new(LineQueue::new());
static LINES: ConstStaticCell<[[u8; COLUMNS]; LINE_BUFFERS]> = ConstStaticCell::new([[0; COLUMNS]; LINE_BUFFERS]);

#[cortex_m_rt::entry]
fn main() -> ! {
    let peripherals = embassy_rp::init(embassy_rp::config::Config::default());
    let mut watchdog = Watchdog::new(peripherals.WATCHDOG);
    watchdog.pause_on_debug(true);
    if let Some(reason) = watchdog.reset_reason() {
        defmt::warn!("restarted by the watchdog: {}", defmt::Debug2Format(&reason));
    }

    // The sensor's master clock is the crystal's 12 MHz.
    let clock = Gpout::new(peripherals.PIN_21);
    clock.set_src(GpoutSrc::Xosc);
    clock.enable();

    let (sender, receiver) = QUEUE.take().split(LINES.take().iter_mut().map(|line| &mut line[..]));
    let pio::Pio { mut common, sm0, .. } = pio::Pio::new(peripherals.PIO0, Interrupts);
    let pins = PixelPins {
        bus: [
            common.make_pio_pin(peripherals.PIN_0),
            common.make_pio_pin(peripherals.PIN_1),
            common.make_pio_pin(peripherals.PIN_2),
            common.make_pio_pin(peripherals.PIN_3),
            common.make_pio_pin(peripherals.PIN_4),
            common.make_pio_pin(peripherals.PIN_5),
            common.make_pio_pin(peripherals.PIN_6),
            common.make_pio_pin(peripherals.PIN_7),
            common.make_pio_pin(peripherals.PIN_8),
            common.make_pio_pin(peripherals.PIN_9),
        ],
        frame_valid: Input::new(peripherals.PIN_10, Pull::None),
    };
    let port = PixelPort::new(&mut common, sm0, pins, dma::Channel::new(peripherals.DMA_CH0, Interrupts));
    // Lines come before packets, and both before the program.
    interrupt::DMA_IRQ_0.set_priority(Priority::P1);
    interrupt::IO_IRQ_BANK0.set_priority(Priority::P1);
    interrupt::SWI_IRQ_1.set_priority(Priority::P2);
    let spawner = software_interrupts::CAMERA.start(interrupt::SWI_IRQ_1);
    spawner.spawn(defmt::unwrap!(pixel_port::receive_lines(port, sender)));

    interrupt::SWI_IRQ_0.set_priority(Priority::P3);
    let spawner = software_interrupts::USB.start(interrupt::SWI_IRQ_0);
    spawner.spawn(defmt::unwrap!(packet_port::serve(peripherals.USB)));

    let bus = i2c::Config::default();
    let bus = I2c::new_blocking(peripherals.I2C0, peripherals.PIN_13, peripherals.PIN_12, bus);
    let store = FrameMemory::new(&Match::PARAMS, FRAMES.take());
    let plan = Plan::new(Match::PARAMS.views(), BASELINE_UM);
    let x = axis_pins(peripherals.PIN_14, peripherals.PIN_15, peripherals.PIN_16, peripherals.PIN_17);
    let y = axis_pins(peripherals.PIN_18, peripherals.PIN_19, peripherals.PIN_20, peripherals.PIN_22);
    let stage = Stepper::new([AXIS, AXIS], x, y, PULSE_NS, Delay);
    let stage = stage.unwrap_or_else(|error| defmt::panic!("the axes: {}", defmt::Display2Format(&error)));
    let mut rig = Rig {
        stage,
        camera: Hm01b0::new(bus, Delay, receiver, store, CONFIGURATION, plan),
        // Low means enabled.
        disable_motors: Output::new(peripherals.PIN_26, Level::High),
        watchdog,
        buffers: MatchBuffers { memory: MEMORY.take(), line: LINE.take(), packet: PACKET.take() },
    };
    rig.run(&plan)
}

/// The pins of an axis. Its switches open a connection to ground, so that a broken wire counts as pressed.
fn axis_pins(
    step: Peri<'static, impl Pin>,
    dir: Peri<'static, impl Pin>,
    low: Peri<'static, impl Pin>,
    high: Peri<'static, impl Pin>,
) -> rig::AxisPins {
    Pins {
        step: Output::new(step, Level::Low),
        dir: Output::new(dir, Level::Low),
        low: Input::new(low, Pull::Up),
        high: Input::new(high, Pull::Up),
    }
}

/// The interrupts that the executors run in. No hardware raises them.
mod software_interrupts {
    #![allow(unsafe_code)]

    use embassy_rp::{executor::InterruptExecutor, interrupt};

    /// Receives lines.
    pub static CAMERA: InterruptExecutor = InterruptExecutor::new();
    /// Sends packets.
    pub static USB: InterruptExecutor = InterruptExecutor::new();

    #[interrupt]
    unsafe fn SWI_IRQ_1() {
        // SAFETY: `main` starts the executor with this interrupt, which enables it.
        unsafe { CAMERA.on_interrupt() }
    }

    #[interrupt]
    unsafe fn SWI_IRQ_0() {
        // SAFETY: as above.
        unsafe { USB.on_interrupt() }
    }
}
