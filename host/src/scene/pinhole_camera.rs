//! A simulated camera on a simulated stage.

use multiscopic_core::{Frame, View};

use super::random::{hash, unit};

/// A pinhole camera on a stage that moves it in its image plane. Pixel `(u, v)` has its centre at whole
/// coordinates, and the optical axis goes through the middle of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeCamera {
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
    /// Focal length in pixels.
    pub focal_px: f64,
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: f64,
    /// The most by which the stage misses a neighbour's position along each axis, in millimetres.
    pub repeatability_mm: f64,
    /// The standard deviation of the sensor's read noise, in electrons.
    pub read_noise: f64,
    /// The electrons in a white pixel, which determine the shot noise. Infinite for a sensor without noise.
    pub full_well: f64,
}

impl PinholeCamera {
    /// A camera with a 37 degree lens, the paper's baseline of 20 mm, a stage that repeats to 0.1 mm, and the
    /// noise of a small sensor.
    pub fn new(width: u32, height: u32) -> PinholeCamera {
        PinholeCamera {
            width,
            height,
            focal_px: 1.5 * f64::from(width),
            baseline_mm: 20.0,
            repeatability_mm: 0.1,
            read_noise: 6.0,
            full_well: 10_000.0,
        }
    }

    /// The same camera with a noiseless sensor and an exact stage.
    pub fn ideal(self) -> PinholeCamera {
        PinholeCamera { repeatability_mm: 0.0, read_noise: 0.0, full_well: f64::INFINITY, ..self }
    }

    /// Where the stage puts the camera for a frame: millimetres to the right of the centre and below it.
    pub(super) fn position(&self, frame: Frame, seed: u64) -> [f64; 2] {
        let Frame::View(view) = frame else { return [0.0; 2] };
        let random = |axis: u64| 2.0 * unit(hash(hash(seed) ^ hash(2 * number(view) + axis))) - 1.0;
        let target = [view.right(), view.down()].map(|baselines| f64::from(baselines) * self.baseline_mm);
        [target[0] + random(0) * self.repeatability_mm, target[1] + random(1) * self.repeatability_mm]
    }

    /// The direction `(x, y, 1)` that image point `(u, v)` sees: x to the right, y down, z along the optical axis.
    pub(super) fn direction(&self, u: f64, v: f64) -> [f64; 2] {
        let middle = |size: u32| (f64::from(size) - 1.0) / 2.0;
        [(u - middle(self.width)) / self.focal_px, (v - middle(self.height)) / self.focal_px]
    }
}

/// A number for each frame: 0 for the centre, greater ones for views.
pub(super) fn frame_number(frame: Frame) -> u64 {
    match frame {
        Frame::Center => 0,
        Frame::View(view) => 1 + number(view),
    }
}

/// A number for each view: its place in [`View::CROSS`], and a greater one for any other.
pub(super) fn number(view: View) -> u64 {
    let place = View::CROSS.into_iter().position(|other| other == view);
    let index = |baselines: i8| (baselines + View::MAX_OFFSET) as u64;
    place.map_or_else(|| 4 + 64 * index(view.down()) + index(view.right()), |place| place as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stage_stops_near_its_targets() {
        let camera = PinholeCamera::new(64, 48);
        let mut farthest: f64 = 0.0;
        for seed in 0..200 {
            for view in View::CROSS {
                let [x, y] = camera.position(Frame::View(view), seed);
                let [ideal_x, ideal_y] = camera.ideal().position(Frame::View(view), seed);
                assert_eq!(ideal_x.abs() + ideal_y.abs(), 20.0);
                farthest = farthest.max((x - ideal_x).abs()).max((y - ideal_y).abs());
            }
            assert_eq!(camera.position(Frame::Center, seed), [0.0, 0.0]);
        }
        assert!(farthest > 0.09 && farthest <= 0.1, "{farthest}");
        assert_eq!(camera.ideal().position(Frame::View(View::TOP), 0), [0.0, -20.0]);
        assert_eq!(camera.ideal().position(Frame::View(View::RIGHT), 0), [20.0, 0.0]);
        assert_eq!(camera.ideal().position(Frame::View(View::new(-3, 2).unwrap()), 0), [-60.0, 40.0]);
    }
}
