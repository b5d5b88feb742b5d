//! A camera that sees a wall with a random texture.

use std::{
    error, fmt,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use image::{GrayImage, Luma};
use multiscopic::capture::{BlockingCamera, Clock};

/// Width and height of its pictures in pixels.
pub const SIZE: [u32; 2] = [64, 40];
/// The way of the stage for each pixel by which the wall moves, in micrometres.
pub const PIXEL_UM: f64 = 500.0;

/// A fault of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blindness {
    /// The next picture fails.
    Once,
    /// All pictures fail.
    Gone,
    /// No picture comes.
    Silent,
}

/// The fault, shared by the camera and those who make it fail.
pub type SharedBlindness = Arc<Mutex<Option<Blindness>>>;

/// The camera.
pub struct Eye {
    /// Its place along the image's lines, in micrometres.
    pub place_um: Arc<dyn Fn() -> f64 + Send + Sync>,
    /// Its fault.
    pub blindness: SharedBlindness,
    /// The clock by which it falls silent.
    pub clock: Arc<dyn Clock>,
}

/// The reason why there is no picture.
#[derive(Debug)]
pub struct EyeError(&'static str);

impl fmt::Display for EyeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl error::Error for EyeError {}

impl BlockingCamera for Eye {
    type Error = EyeError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, EyeError> {
        let found = {
            let mut blindness = self.blindness.lock().unwrap_or_else(PoisonError::into_inner);
            let found = *blindness;
            *blindness = found.filter(|found| *found != Blindness::Once);
            found
        };
        match found {
            None => Ok(picture((self.place_um)())),
            Some(Blindness::Once) => Err(EyeError("a damaged picture")),
            Some(Blindness::Gone) => Err(EyeError("the sensor is gone")),
            Some(Blindness::Silent) => {
                let start = self.clock.now();
                // It only looks at the clock: time is another thread's.
                while self.clock.now() - start < timeout && !is_cancelled.load(Ordering::Relaxed) {
                    thread::sleep(Duration::from_millis(2));
                }
                Err(EyeError("no picture came"))
            }
        }
    }
}

/// The wall, seen from a place.
fn picture(place_um: f64) -> GrayImage {
    let shift = (place_um / PIXEL_UM).round() as i32;
    let texture = |u: i32, v: u32| {
        let hash = (u as u32).wrapping_mul(0x9E37_79B1) ^ v.wrapping_mul(0x85EB_CA77);
        (hash ^ hash >> 15).wrapping_mul(0x2C1B_3C6D) >> 24
    };
    GrayImage::from_fn(SIZE[0], SIZE[1], |u, v| Luma([texture(u as i32 + shift, v) as u8]))
}
