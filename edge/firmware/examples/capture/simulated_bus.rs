//! The simulated pixel bus: an interrupt for each line, with pixels from a file or noise.

use core::cell::RefCell;
use cortex_m::{
    asm,
    interrupt::{self, Mutex},
    peripheral::SCB,
};
use embedded_io::Read;
use multiscopic_drivers::hm01b0::{LineSender, Size};
use multiscopic_firmware::HostFile;

/// The size of the simulated frames.
pub const SIZE: Size = Size::Qqvga;

/// The bus, shared with the interrupt.
static BUS: Mutex<RefCell<Option<Bus>>> = Mutex::new(RefCell::new(None));

/// A frame as the bus sends it.
pub struct Transmission {
    /// The file of the pixels. Without one, they are noise.
    pub scene: Option<HostFile>,
    /// The number of lines after which the frame ends.
    pub lines: usize,
    /// A line that is too short.
    pub short_line: Option<usize>,
    /// A line of the scene that is left out.
    pub missing_line: Option<usize>,
    /// A line that is followed by itself.
    pub doubled_line: Option<usize>,
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
pub fn begin(frame: Transmission) {
    with_bus(|bus| {
        (bus.frame, bus.next) = (frame, 0);
        bus.sender.begin_frame();
    });
}

/// Sends the next line from an interrupt, as the bus of a microcontroller does.
pub fn send_line() {
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
