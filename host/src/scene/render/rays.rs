//! The rays of a camera with a lens, quickly.

use rayon::prelude::*;

use crate::{
    lens::CameraModel,
    scene::{pinhole_camera::PinholeCamera, pose::Pose, posed_camera::PosedCamera, ray::Ray, vec3::Vec3},
};

/// Adjacent pixels of a row that share one search for the objects in view. The last run of a row may end beside the image.
pub const RUN: u32 = 16;

/// The distance between the places whose directions are computed, in pixels. Between them, a lens changes directions nearly
/// linearly: at this distance the error is a hundredth of a pixel.
const STEP: f64 = 4.0;

/// The rays of a camera. Undistorting a lens takes long, so it is done on a grid, and rays between its places are interpolated.
pub struct Rays<'a> {
    camera: &'a PosedCamera,
    grid: Option<Grid>,
}

/// The directions of places [`STEP`] pixels apart, from half a step outside the top left pixel on, row by row.
struct Grid {
    columns: usize,
    directions: Vec<Option<[f64; 2]>>,
}

impl<'a> Rays<'a> {
    pub fn new(camera: &'a PosedCamera) -> Rays<'a> {
        Rays { camera, grid: camera.lens.as_ref().map(|lens| Grid::new(&camera.sensor, lens)) }
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
