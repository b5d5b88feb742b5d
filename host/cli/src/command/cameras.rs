//! Cameras of any kind, as the command line names them.

use std::{
    sync::{Arc, OnceLock, atomic::AtomicBool},
    time::{Duration, Instant},
};

use multiscopic::{
    Error, Picture, Result,
    capture::{
        Arrival, BlockingCamera, SimulatedCamera,
        camera::{ExecCamera, HttpCamera, V4l2Camera},
    },
};

use super::options::{RealCamera, SettingsOptions};

/// The note on what a camera does not lock though it should, once it has taken a picture and if there is something.
pub type UnlockedNote = Arc<OnceLock<String>>;

/// A camera of any kind.
pub enum AnyCamera {
    /// A V4L2 camera, and where its note goes.
    V4l2(Box<V4l2Camera>, UnlockedNote),
    /// A command that takes pictures.
    Exec(Box<ExecCamera>),
    /// A camera of a network.
    Http(Box<HttpCamera>),
    /// One without hardware.
    Simulated(Box<SimulatedCamera>),
}

impl AnyCamera {
    /// Opens a real camera. Its note goes to `note`.
    pub fn open(camera: &RealCamera, options: &SettingsOptions, note: &UnlockedNote) -> Result<AnyCamera> {
        let settings = options.settings();
        let refused = |place: &str| match options.of_device() {
            Some(option) => Err(Error::Usage(format!("{option} is for V4L2 cameras: set it {place}"))),
            None => Ok(()),
        };
        match camera {
            RealCamera::Device(path) => Ok(AnyCamera::V4l2(Box::new(V4l2Camera::open(path, &settings)?), note.clone())),
            RealCamera::Exec(command) => {
                refused("in the command behind --camera exec:, which the camera belongs to")?;
                Ok(AnyCamera::Exec(Box::new(ExecCamera::open(command, settings.average)?)))
            }
            RealCamera::Http(url) => {
                refused("in the camera itself, or in its address")?;
                Ok(AnyCamera::Http(Box::new(HttpCamera::new(url.clone(), settings.average))))
            }
        }
    }

    /// The camera in words, and the width and height of its pictures in pixels. A command and a camera of a network take one to find
    /// out.
    pub fn describe(&mut self, timeout: Duration) -> Result<(String, [u32; 2])> {
        Ok(match self {
            AnyCamera::V4l2(camera, _) => (camera.to_string(), camera.size()),
            AnyCamera::Exec(camera) => {
                let size = camera.take(timeout, &AtomicBool::new(false))?.dimensions().into();
                (camera.to_string(), size)
            }
            AnyCamera::Http(camera) => {
                let size = camera.take(timeout, &AtomicBool::new(false))?.dimensions().into();
                (camera.to_string(), size)
            }
            AnyCamera::Simulated(camera) => (camera.to_string(), camera.size()),
        })
    }
}

impl BlockingCamera for AnyCamera {
    type Error = Error;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture> {
        match self {
            AnyCamera::V4l2(camera, note) => {
                let picture = camera.take(timeout, is_cancelled)?;
                note_unlocked(camera, note);
                Ok(picture)
            }
            AnyCamera::Exec(camera) => Ok(camera.take(timeout, is_cancelled)?),
            AnyCamera::Http(camera) => Ok(camera.take(timeout, is_cancelled)?),
            AnyCamera::Simulated(camera) => camera.take(timeout, is_cancelled).map_err(|never| match never {}),
        }
    }

    fn next(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival> {
        match self {
            AnyCamera::V4l2(camera, note) => {
                let arrival = camera.next(timeout, is_cancelled)?;
                note_unlocked(camera, note);
                Ok(arrival)
            }
            AnyCamera::Simulated(camera) => camera.next(timeout, is_cancelled).map_err(|never| match never {}),
            AnyCamera::Http(camera) => Ok(camera.next(timeout, is_cancelled)?),
            AnyCamera::Exec(_) => self.take(timeout, is_cancelled).map(|picture| Arrival { picture, at: Instant::now() }),
        }
    }
}

/// Notes what a camera does not lock though it should, if there is something.
fn note_unlocked(camera: &V4l2Camera, note: &UnlockedNote) {
    let Some((last, others)) = camera.unlocked().split_last() else { return };
    let names = if others.is_empty() { (*last).into() } else { format!("{} and {last}", others.join(", ")) };
    let _ = note.set(format!(
        "the camera does not let its {names} be locked, so pictures may differ in brightness or sharpness: keep the light constant; \
         `match --align` evens out brightness"
    ));
}
