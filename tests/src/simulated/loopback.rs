//! Loopback devices: cameras that show the frames they are fed.

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
use v4l::{Device, Format, FourCC, video::Output};

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
