//! Lines from the sensor's parallel port: a state machine samples the pixels, and DMA puts them into line buffers.

use embassy_futures::select::{Either, select};
use embassy_rp::{
    dma::Channel,
    gpio::Input,
    peripherals::PIO0,
    pio::{Common, Config, Direction, FifoJoin, Pin, ShiftConfig, ShiftDirection, StateMachine, program::pio_asm},
};
use multiscopic_drivers::hm01b0::LineSender;

use crate::COLUMNS;

/// The sensor's port.
pub struct PixelPins {
    /// D0 to D7, on pins that follow each other.
    pub data: [Pin<'static, PIO0>; 8],
    /// PCLKO, on the pin after D7. A pixel is stable at its rising edge.
    pub pixel_clock: Pin<'static, PIO0>,
    /// LVLD, on the pin after that. It is high while a line is read out.
    pub line_valid: Pin<'static, PIO0>,
    /// FVLD, high while a frame is read out.
    pub frame_valid: Input<'static>,
}

/// The port with its state machine and its DMA channel.
pub struct PixelPort {
    sampler: StateMachine<'static, PIO0, 0>,
    channel: Channel<'static>,
    frame_valid: Input<'static>,
}

impl PixelPort {
    /// Starts to sample.
    pub fn new(
        common: &mut Common<'static, PIO0>,
        mut sampler: StateMachine<'static, PIO0, 0>,
        pins: PixelPins,
        channel: Channel<'static>,
    ) -> PixelPort {
        let data = pins.data.each_ref();
        sampler.set_pin_dirs(Direction::In, &data);
        sampler.set_pin_dirs(Direction::In, &[&pins.pixel_clock, &pins.line_valid]);
        // Pins count from D0: 8 is the pixel clock, 9 says that there is a line.
        let program = pio_asm!(".wrap_target", "wait 1 pin 9", "wait 1 pin 8", "in pins, 8", "wait 0 pin 8", ".wrap");
        let mut config = Config::default();
        config.use_program(&common.load_program(&program.program), &[]);
        config.set_in_pins(&data);
        // Each pixel is pushed by itself, since a line of an odd size has no whole number of words.
        config.shift_in = ShiftConfig { threshold: 8, direction: ShiftDirection::Left, auto_fill: true };
        config.fifo_join = FifoJoin::RxOnly;
        sampler.set_config(&config);
        sampler.set_enable(true);
        PixelPort { sampler, channel, frame_valid: pins.frame_valid }
    }

    /// Puts the next line into `line`. Returns true unless the frame ended first.
    async fn read_line(&mut self, line: &mut [u8]) -> bool {
        let pixels = self.sampler.rx().dma_pull(&mut self.channel, line, false);
        matches!(select(pixels, self.frame_valid.wait_for_low()).await, Either::First(()))
    }

    /// Drops what a torn frame may have left.
    fn restart(&mut self) {
        self.sampler.set_enable(false);
        self.sampler.clear_fifos();
        self.sampler.restart();
        self.sampler.set_enable(true);
    }
}

/// Sends the lines of all frames to the program.
///
/// A pixel that is lost shifts all that follow, so that the frame ends before its last line is full. The receiver then takes
/// the frame again.
#[embassy_executor::task]
pub async fn receive_lines(mut port: PixelPort, mut sender: LineSender<'static, 'static>) -> ! {
    let mut dropped = [0; COLUMNS];
    loop {
        port.frame_valid.wait_for_high().await;
        sender.begin_frame();
        while port.read_line(sender.buffer().unwrap_or(&mut dropped)).await {
            sender.end_line(COLUMNS);
        }
        sender.end_frame();
        port.restart();
    }
}
