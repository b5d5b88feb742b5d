//! The rays of a camera with a lens, quickly.

use std::sync::Arc;

use rayon::prelude::*;

use crate::{
    lens::CameraModel,
    scene::{
        even_square, gaussian,
        geometry::{Pose, Ray, Vec3},
        hash,
        pinhole_camera::{PinholeCamera, PosedCamera},
    },
};

/// Adjacent pixels of a row that share one search for the objects in view. The last run of a row may end beside the image.
pub const RUN: u32 = 16;

/// The distance between the places whose directions are computed, in pixels. Between them, a lens changes directions nearly
/// linearly: at this distance the error is a hundredth of a pixel.
const STEP: f64 = 4.0;

/// The rays of a camera. Undistorting a lens takes long, so it is done on a grid, and rays between its places are interpolated.
pub struct Rays {
    camera: PosedCamera,
    grid: Option<Arc<Grid>>,
}

/// The directions of places [`STEP`] pixels apart, from half a step outside the top left pixel on, row by row.
struct Grid {
    columns: usize,
    directions: Vec<Option<[f64; 2]>>,
}

impl Rays {
    pub fn new(camera: &PosedCamera) -> Rays {
        Rays { camera: *camera, grid: camera.lens.as_ref().map(|lens| Arc::new(Grid::new(&camera.sensor, lens))) }
    }

    /// The rays of the same camera elsewhere.
    pub fn at(&self, pose: Pose) -> Rays {
        Rays { camera: PosedCamera { pose, ..self.camera }, grid: self.grid.clone() }
    }

    /// The ray through image point `(u, v)`, which lies within the image or less than half a step beside it.
    pub fn ray(&self, u: f64, v: f64) -> Option<Ray> {
        match self.grid.as_ref().and_then(|grid| grid.direction(u, v)) {
            Some(direction) => Some(ray(&self.camera.pose, direction)),
            // There is no lens, or its model ends nearby.
            None => self.camera.ray(u, v),
        }
    }
}

fn ray(pose: &Pose, [x, y]: [f64; 2]) -> Ray {
    Ray { origin: pose.origin, direction: pose.world_direction(Vec3::new(x, y, 1.0)) }
}

impl Grid {
    fn new(&PinholeCamera { width, height, .. }: &PinholeCamera, lens: &CameraModel) -> Grid {
        // A run of pixels may end beside the image.
        let count = |side: u32| (f64::from(side + RUN) / STEP).ceil() as usize + 2;
        let (columns, rows) = (count(width), count(height));
        let place = |index: usize| (index as f64 - 0.5) * STEP;
        let direction = |k: usize| lens.direction([place(k % columns), place(k / columns)]);
        Grid { columns, directions: (0..rows * columns).into_par_iter().map(direction).collect() }
    }

    /// The direction that an image point sees, interpolated bilinearly.
    fn direction(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        let [x, y] = [u, v].map(|at| at / STEP + 0.5);
        let at = |i: usize, j: usize| *self.directions.get((y as usize + j) * self.columns + x as usize + i)?;
        let mix = |a: [f64; 2], b: [f64; 2], share: f64| [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
        let row = |j: usize| Some(mix(at(0, j)?, at(1, j)?, x.fract()));
        Some(mix(row(0)?, row(1)?, y.fract()))
    }
}

/// The number of rays that each pixel takes, and of points of the lamp that light a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Four rays for each pixel, more at edges, and soft shadows.
    Fine,
    /// Two rays for each pixel, more at edges, and coarse shadows: for pictures that are blurred afterwards.
    Quick,
}

/// The places of the rays of a quick pixel, in pixels from its middle. No two share a row or a column, and both the first two
/// and all four are around the middle.
const QUICK: [[f64; 2]; 4] = [[-0.375, -0.125], [0.375, 0.125], [0.125, -0.375], [-0.125, 0.375]];

impl Quality {
    /// The most rays of a pixel that sees a single smooth surface.
    pub const MAX_SURFACE_RAYS: usize = 4;

    /// The rays of a pixel that sees a single smooth surface.
    pub fn surface_rays(self) -> u32 {
        match self {
            Quality::Fine => 4,
            Quality::Quick => 2,
        }
    }

    /// The rays of a pixel that sees the edge of a surface.
    pub fn edge_rays(self) -> u32 {
        match self {
            Quality::Fine => 8,
            Quality::Quick => 4,
        }
    }

    /// The number of points of the lamp that are sampled first, and of those in a penumbra, where only some of those are
    /// visible.
    pub fn lamp_points(self) -> [u32; 2] {
        match self {
            Quality::Fine => [4, 16],
            Quality::Quick => [2, 8],
        }
    }

    /// The place where a ray meets the pixel, from its middle. The second ray of a fine pixel goes through the middle.
    pub fn place(self, sample: u32) -> [f64; 2] {
        match self {
            Quality::Fine => even_square(sample).map(|x| x - 0.5),
            Quality::Quick => QUICK[sample as usize % QUICK.len()],
        }
    }

    /// Returns true if a ray traces a blurred reflection. It is expensive: half of a pixel's rays trace it, at twice the
    /// weight.
    pub fn traces_blurred_reflection(self, sample: u32) -> bool {
        match self {
            Quality::Fine => sample & 2 != 0,
            Quality::Quick => sample & 1 != 0,
        }
    }
}

/// The pixel that the camera makes of `light`. The hash `place` decides its noise.
pub fn develop(camera: &PinholeCamera, light: Vec3, place: u64) -> [u8; 3] {
    let mut channel = 0;
    [light.x, light.y, light.z].map(|light| {
        channel += 1;
        let read = camera.read_noise / camera.full_well;
        let deviation = (light / camera.full_well + read * read).sqrt();
        let signal = light + deviation * gaussian(hash(place ^ (channel << 56)));
        (tone(signal.max(0.0)) * 255.0 + 0.5) as u8
    })
}

/// Linear light to display brightness: a rational approximation of a film curve, which compresses highlights,
/// then a gamma of 2.
fn tone(light: f64) -> f64 {
    let film = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14);
    film.min(1.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        lens::{Lens, LensModel},
        scene::Scene,
    };

    #[test]
    fn rays_between_the_places_are_nearly_exact() {
        let sensor = PinholeCamera::new(320, 240);
        for (model, coefficients) in [
            (LensModel::PlumbBob, &[-0.25, 0.08, 0.0012, -0.0007, -0.01][..]),
            (LensModel::Equidistant, &[-0.01, 0.02, -0.01, 0.0]),
        ] {
            let lens = Lens::new(model, coefficients).unwrap();
            let lens = CameraModel { size: None, focal_px: [300.0; 2], principal_point: [161.5, 118.25], lens };
            let camera = PosedCamera { sensor, lens: Some(lens), pose: Scene::demo().viewpoint };
            let rays = Rays::new(&camera);
            let mut largest = 0.0_f64;
            for k in 0..2000_u32 {
                let (u, v) = (f64::from(k % 321) * 0.999 - 0.5, f64::from(k % 241) * 0.998 - 0.5);
                let [exact, quick] = [camera.ray(u, v).unwrap(), rays.ray(u, v).unwrap()];
                largest = largest.max(300.0 * (exact.direction - quick.direction).length());
            }
            assert!(largest < 0.02, "{model}: {largest} pixels");
        }
    }
}
