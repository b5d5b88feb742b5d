//! Cameras of Linux's own drivers: loopback devices, which show the frames that they are fed, and those of the virtual driver
//! vivid, which show patterns and fail on demand.

use std::{
    io::{self, Write},
    path::Path,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use image::GrayImage;
use multiscopic::capture::camera::{FrameLayout, PixelFormat};
use v4l::{Control, Device, Format, FourCC, control::Value, video::Output};

/// The time between two frames.
const INTERVAL: Duration = Duration::from_millis(33);

/// Feeds a loopback device with frames until it is dropped.
pub struct Producer {
    frame: Arc<Mutex<Vec<u8>>>,
    /// The number of frames that were fed.
    fed: Arc<AtomicUsize>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Producer {
    /// Feeds `device` with `frame`, which has the given layout, again and again. When this returns, the
    /// device is a camera.
    ///
    /// # Errors
    /// If the device does not accept the format or the frame.
    pub fn start(device: &Path, layout: FrameLayout, frame: Vec<u8>) -> io::Result<Producer> {
        let mut output = Device::with_path(device)?;
        let [width, height] = layout.size;
        let wanted = Format::new(width, height, FourCC::new(&layout.format.fourcc()));
        let given = Output::set_format(&output, &wanted)?;
        let is_same = given.fourcc == wanted.fourcc && [given.width, given.height] == layout.size;
        // The driver reports too large a size for some formats.
        if !is_same || (given.size as usize) < frame.len() {
            let found = format!("{}x{} {} in {} bytes", given.width, given.height, given.fourcc, given.size);
            let message = format!("{} takes {found} instead of {layout} in {}", device.display(), frame.len());
            return Err(io::Error::new(io::ErrorKind::Unsupported, message));
        }
        output.write_all(&frame)?;
        let frame = Arc::new(Mutex::new(frame));
        let is_over = Arc::new(AtomicBool::new(false));
        let fed = Arc::new(AtomicUsize::new(0));
        let (next, count, must_end) = (frame.clone(), fed.clone(), is_over.clone());
        let thread = thread::spawn(move || {
            while !must_end.load(Ordering::Relaxed) {
                // Write whole frames, each in one call: with memory-mapped output, readers see halves of two
                // frames.
                let bytes = next.lock().unwrap_or_else(PoisonError::into_inner).clone();
                output.write_all(&bytes)?;
                count.fetch_add(1, Ordering::Relaxed);
                thread::sleep(INTERVAL);
            }
            Ok(())
        });
        Ok(Producer { frame, fed, is_over, thread: Some(thread) })
    }

    /// Feeds `device` with a grey image.
    ///
    /// # Errors
    /// If the device does not accept the format or the frame.
    pub fn gray(device: &Path, image: &GrayImage) -> io::Result<Producer> {
        let layout = FrameLayout { format: PixelFormat::Grey, size: image.dimensions().into(), stride: 0 };
        Producer::start(device, layout, image.as_raw().clone())
    }

    /// Feeds `frame` from now on.
    pub fn show(&self, frame: Vec<u8>) {
        *self.frame.lock().unwrap_or_else(PoisonError::into_inner) = frame;
    }

    /// Feeds `frame` from now on, and waits until it has been fed.
    pub fn show_now(&self, frame: Vec<u8>) {
        self.show(frame);
        // The frame before may be on its way.
        let last = self.fed.load(Ordering::Relaxed) + 2;
        while self.fed.load(Ordering::Relaxed) < last && self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            thread::sleep(INTERVAL);
        }
    }
}

impl Drop for Producer {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        // Do not hide the failure of a test that is already panicking.
        if !thread::panicking() {
            assert!(matches!(ended, None | Some(Ok(Ok(())))), "the producer fed its device to the end: {ended:?}");
        }
    }
}

/// The driver's control for the test pattern, and the one for its text overlay.
const PATTERN: u32 = 0x00F0_F000;
const TEXT: u32 = 0x00F0_F001;

/// A still test pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// Eight bars of equal width: white, yellow, cyan, green, magenta, red, blue, black.
    Bars = 1,
    /// Black.
    Black = 5,
    /// White.
    White = 6,
}

/// A fault of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// This percentage of frames is dropped from now on.
    Dropped(u8),
    /// The device is disconnected until nobody has it open.
    Disconnected,
    /// The next frame is flagged as damaged.
    Damaged,
    /// The next request for buffers fails.
    Buffers,
    /// The next buffer cannot be queued.
    Queue,
    /// The next stream does not start.
    Start,
    /// The stream fails for good.
    Fatal,
}

/// Shows `pattern` without a text overlay.
///
/// # Errors
/// If `device` does not belong to this driver.
pub fn show(device: &Path, pattern: Pattern) -> io::Result<()> {
    let device = Device::with_path(device)?;
    set(&device, TEXT, 2)?;
    set(&device, PATTERN, pattern as i64)
}

/// Makes a camera fail.
///
/// # Errors
/// If `device` does not belong to this driver.
pub fn inject(device: &Path, fault: Fault) -> io::Result<()> {
    let device = Device::with_path(device)?;
    match fault {
        Fault::Dropped(percent) => set(&device, 0x00F0_F040, percent.into()),
        Fault::Disconnected => set(&device, 0x00F0_F041, 1),
        Fault::Damaged => set(&device, 0x00F0_F042, 1),
        Fault::Buffers => set(&device, 0x00F0_F043, 1),
        Fault::Queue => set(&device, 0x00F0_F044, 1),
        Fault::Start => set(&device, 0x00F0_F045, 1),
        Fault::Fatal => set(&device, 0x00F0_F046, 1),
    }
}

fn set(device: &Device, id: u32, value: i64) -> io::Result<()> {
    device.set_control(Control { id, value: Value::Integer(value) })
}

/// The grey value of each pixel of an uncompressed camera frame, row by row, straight from the definitions of the pixel formats.
///
/// # Panics
/// If the frame is too short or compressed.
pub fn luma(layout: &FrameLayout, frame: &[u8]) -> Vec<u8> {
    let [width, height] = layout.size.map(|side| side as usize);
    let bytes = pixel_bytes(layout.format);
    let stride = if layout.stride == 0 { width * bytes } else { layout.stride as usize };
    let pixel = |u: usize, v: usize| {
        let at = |i: usize| u32::from(frame[v * stride + u * bytes + i]);
        let word = || at(0) + 256 * at(1);
        let grey = |red: usize, green: usize, blue: usize| (77 * at(red) + 150 * at(green) + 29 * at(blue) + 128) / 256;
        let gray = match layout.format {
            PixelFormat::Uyvy | PixelFormat::Vyuy => at(1),
            PixelFormat::Y10 => word() % 1024 / 4,
            PixelFormat::Y12 => word() % 4096 / 16,
            PixelFormat::Y16 => word() / 256,
            PixelFormat::Rgb3 => grey(0, 1, 2),
            PixelFormat::Bgr3 => grey(2, 1, 0),
            _ => at(0),
        };
        u8::try_from(gray).expect("8 bits")
    };
    (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| pixel(u, v)).collect()
}

/// Bytes of a pixel in the first plane of a frame.
///
/// # Panics
/// If frames of this format are compressed.
pub fn pixel_bytes(format: PixelFormat) -> usize {
    match format {
        PixelFormat::Grey | PixelFormat::Nv12 | PixelFormat::Nv21 | PixelFormat::Yu12 | PixelFormat::Yv12 => 1,
        PixelFormat::Yuyv | PixelFormat::Yvyu | PixelFormat::Uyvy | PixelFormat::Vyuy => 2,
        PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => 2,
        PixelFormat::Rgb3 | PixelFormat::Bgr3 => 3,
        PixelFormat::Mjpg | PixelFormat::Jpeg => panic!("a compressed frame"),
    }
}

/// Bytes of a frame whose rows are not padded and whose sides are even. Four pixels share two bytes of chroma in planes.
///
/// # Panics
/// If frames of this format are compressed.
pub fn frame_bytes(format: PixelFormat, [width, height]: [usize; 2]) -> usize {
    let chroma = match format {
        PixelFormat::Nv12 | PixelFormat::Nv21 | PixelFormat::Yu12 | PixelFormat::Yv12 => width * height / 2,
        _ => 0,
    };
    width * height * pixel_bytes(format) + chroma
}
