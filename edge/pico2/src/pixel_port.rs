//! Lines from the sensor's pixel bus: a state machine samples the pixels, and DMA puts them into line buffers.

use embassy_futures::select::select;
use embassy_rp::{
    dma::{Channel, Transfer},
    gpio::{Input, Pull},
    peripherals::PIO0,
    pio::{Common, Config, Direction, Pin, ShiftConfig, ShiftDirection, StateMachine, program::pio_file},
};
use embassy_time::{Duration, Timer};
use multiscopic_drivers::hm01b0::LineSender;

use crate::{
    COLUMNS,
    line_format::{self, EXTRA, PINS},
    mechanics::CONFIGURATION,
};

/// The bytes of a sampled line.
const LINE_BYTES: usize = COLUMNS + EXTRA;
/// A time longer than a line's: a microsecond for each of its clocks, of which the sensor has at least 1.5 million a second.
const LINE: Duration = Duration::from_micros(CONFIGURATION.line_clocks as u64);

/// The sensor's port. Its pins have no pulls: resistors hold PCLKO, LVLD and FVLD low while the sensor does not drive them.
pub struct PixelPins {
    /// PCLKO, LVLD and D0 to D7, on pins that follow each other.
    pub bus: [Pin<'static, PIO0>; PINS],
    /// FVLD, high while a frame is read out.
    pub frame_valid: Input<'static>,
}

/// The port with its state machine and its DMA channel.
pub struct PixelPort {
    sampler: StateMachine<'static, PIO0, 0>,
    config: Config<'static, PIO0>,
    channel: Channel<'static>,
    frame_valid: Input<'static>,
}

impl PixelPort {
    /// Starts to sample.
    pub fn new(
        common: &mut Common<'static, PIO0>,
        mut sampler: StateMachine<'static, PIO0, 0>,
        mut pins: PixelPins,
        channel: Channel<'static>,
    ) -> PixelPort {
        pins.bus.iter_mut().for_each(|pin| pin.set_pull(Pull::None));
        let bus = pins.bus.each_ref();
        sampler.set_pin_dirs(Direction::In, &bus);
        let program = pio_file!("src/lines.pio");
        let defines = &program.public_defines;
        defmt::assert_eq!(
            defines.DATA_LINES as usize,
            CONFIGURATION.data_lines.count(),
            "lines.pio and mechanics.rs differ in the data lines"
        );
        let mut program_in_memory = common.load_program(&program.program);
        program_in_memory.origin = defines.start as u8;
        let mut config = Config::default();
        config.use_program(&program_in_memory, &[]);
        // All of them: the state machine sees pins beyond these as low.
        config.set_in_pins(&bus);
        // Each byte is pushed by itself, since a line has no whole number of words.
        config.shift_in = ShiftConfig { threshold: 8, direction: ShiftDirection::Left, auto_fill: true };
        config.shift_out = ShiftConfig { threshold: 32, direction: ShiftDirection::Right, auto_fill: false };
        let mut port = PixelPort { sampler, config, channel, frame_valid: pins.frame_valid };
        port.restart();
        port
    }

    /// Asks for a line. The transfer ends with it.
    fn request<'a>(&'a mut self, line: &'a mut [u8; LINE_BYTES]) -> (Transfer<'a>, &'a mut Input<'static>) {
        let (rx, tx) = self.sampler.rx_tx();
        let transfer = rx.dma_pull(&mut self.channel, line, false);
        tx.push(line_format::last_clock(COLUMNS, CONFIGURATION.data_lines));
        (transfer, &mut self.frame_valid)
    }

    /// Sends the lines of a frame.
    async fn receive_frame(&mut self, sender: &mut LineSender<'static, 'static>) {
        let mut line = [0; LINE_BYTES];
        // It is asked for before the frame begins, since it may begin with it.
        let (mut transfer, mut frame_valid) = self.request(&mut line);
        frame_valid.wait_for_high().await;
        sender.begin_frame();
        loop {
            let is_over = select(&mut transfer, frame_valid.wait_for_low()).await.is_second();
            // The last line may end after the frame.
            if is_over && select(&mut transfer, Timer::after(LINE)).await.is_second() {
                break;
            }
            drop(transfer);
            if let Some(buffer) = sender.buffer() {
                buffer.copy_from_slice(&line[..COLUMNS]);
            }
            sender.end_line(line_format::pixels(&line, COLUMNS, CONFIGURATION.data_lines));
            (transfer, frame_valid) = self.request(&mut line);
        }
        sender.end_frame();
    }

    /// Drops the request of a line that did not come, and starts the program.
    fn restart(&mut self) {
        self.sampler.set_enable(false);
        self.sampler.clear_fifos();
        self.sampler.restart();
        self.sampler.set_config(&self.config);
        self.sampler.set_enable(true);
    }
}

/// Sends the lines of all frames to the program, each with the number of pixels that it came with. The receiver takes a frame
/// again if a line is too short or too long, or if lines are missing.
#[embassy_executor::task]
pub async fn receive_lines(mut port: PixelPort, mut sender: LineSender<'static, 'static>) -> ! {
    loop {
        port.receive_frame(&mut sender).await;
        port.restart();
    }
}
