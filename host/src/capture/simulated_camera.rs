//! A camera that sees the scene of the demo.

use std::{
    convert::Infallible,
    fmt,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use super::{
    acquisition::BlockingCamera,
    imperfections::{CameraTiming, Imperfections},
    stage::{SimulatedPlace, StagePose},
    sweep::Arrival,
};
use crate::{
    images::Picture,
    scene::{PinholeCamera, Pose, PosedCamera, Ray, Scene, render_moving, trace},
};

/// A camera without hardware: it renders the scene of the demo from where a simulated stage has moved it.
#[derive(Clone, Debug)]
pub struct SimulatedCamera {
    sensor: PinholeCamera,
    imperfections: Imperfections,
    place: SimulatedPlace,
    /// Pictures taken so far, by all clones, of which each has noise of its own.
    taken: Arc<AtomicU64>,
}

impl SimulatedCamera {
    /// A camera with this sensor, which `place` carries.
    pub fn new(sensor: PinholeCamera, imperfections: &Imperfections, place: SimulatedPlace) -> SimulatedCamera {
        SimulatedCamera { sensor, imperfections: *imperfections, place, taken: Arc::default() }
    }

    /// Width and height of its pictures in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.sensor.width, self.sensor.height]
    }

    /// The focal length that such a camera should have, in pixels. A lens of its own may have another.
    pub fn nominal_focal_px(&self) -> f64 {
        self.sensor.focal_px
    }

    /// The timing of its frames while it moves.
    pub fn timing(&self) -> &CameraTiming {
        &self.imperfections.camera
    }

    /// The place where the stage has moved it.
    pub(super) fn place(&self) -> StagePose {
        self.place.get()
    }

    /// A picture whose rows are the means of those from some places.
    pub(super) fn moving(&self, places: impl Fn(u32) -> Vec<StagePose> + Sync) -> Picture {
        let number = 1 + self.taken.fetch_add(1, Ordering::Relaxed);
        let scene = Scene::demo();
        let poses = |row: u32| places(row).into_iter().map(|place| self.at(scene.viewpoint, place).pose).collect();
        Picture::Rgb(render_moving(&scene, &self.at(scene.viewpoint, StagePose::default()), poses, number))
    }

    /// The camera where a stage has moved it, whose axes are those of the scene's viewpoint.
    fn at(&self, viewpoint: Pose, StagePose { position_mm: [right, down], rotation_deg }: StagePose) -> PosedCamera {
        let stage = viewpoint.moved([right, down, 0.0]).rotated(rotation_deg.map(f64::to_radians));
        let pose = stage.rotated(self.imperfections.mount_deg.map(f64::to_radians));
        PosedCamera { sensor: self.sensor, lens: self.imperfections.lens, pose }
    }

    /// The distances from the plane in which the stage moves to the things that points of the centre's picture show, in
    /// millimetres. `None` for points that show nothing.
    pub fn true_depths(&self, points: &[Option<[f64; 2]>]) -> Vec<Option<f64>> {
        let scene = Scene::demo();
        let (camera, ahead) = (self.at(scene.viewpoint, StagePose::default()), scene.viewpoint.axes[2]);
        // A ray goes a millimetre ahead, to be measured in millimetres ahead.
        let ray = |[u, v]: [f64; 2]| {
            let Ray { origin, direction } = camera.ray(u, v)?;
            let along = direction.dot(ahead);
            (along > 0.0).then(|| Ray { origin, direction: direction * (1.0 / along) })
        };
        let rays: Vec<Option<Ray>> = points.iter().map(|point| ray((*point)?)).collect();
        let mut depths = trace(&scene, &rays.iter().flatten().copied().collect::<Vec<_>>()).into_iter();
        rays.iter().map(|ray| ray.and_then(|_| depths.next().flatten())).collect()
    }
}

impl BlockingCamera for SimulatedCamera {
    type Error = Infallible;

    fn take(&mut self, _: Duration, _: &AtomicBool) -> Result<Picture, Infallible> {
        let place = self.place.get();
        Ok(self.moving(|_| vec![place]))
    }

    /// It exposes at the time of the call, and renders afterwards.
    fn next(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival, Infallible> {
        let at = Instant::now();
        self.take(timeout, is_cancelled).map(|picture| Arrival { picture, at })
    }
}

/// One line: `simulated, 640x480`.
impl fmt::Display for SimulatedCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size();
        write!(f, "simulated, {width}x{height}")
    }
}
