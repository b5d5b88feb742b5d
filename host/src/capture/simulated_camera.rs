//! A camera that sees the scene of the demo.

use std::{convert::Infallible, fmt, sync::atomic::AtomicBool, time::Duration};

use image::GrayImage;

use super::{stage::SimulatedPlace, threaded_camera::BlockingCamera};
use crate::{
    images::Picture,
    scene::{PinholeCamera, Scene, render_at},
};

/// A camera without hardware: it renders the scene of the demo from where a simulated stage has moved it.
#[derive(Clone, Debug)]
pub struct SimulatedCamera {
    camera: PinholeCamera,
    place: SimulatedPlace,
    /// Pictures taken so far, of which each has noise of its own.
    taken: u64,
}

impl SimulatedCamera {
    /// A camera of this lens and sensor, which `place` carries.
    pub fn new(camera: PinholeCamera, place: SimulatedPlace) -> SimulatedCamera {
        SimulatedCamera { camera, place, taken: 0 }
    }
}

impl BlockingCamera for SimulatedCamera {
    type Error = Infallible;

    fn take(&mut self, _: Duration, _: &AtomicBool) -> Result<GrayImage, Infallible> {
        self.taken += 1;
        Ok(Picture::Rgb(render_at(&Scene::demo(), &self.camera, self.place.get(), self.taken)).to_gray())
    }
}

/// One line: `simulated, 640x480`.
impl fmt::Display for SimulatedCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "simulated, {}x{}", self.camera.width, self.camera.height)
    }
}
