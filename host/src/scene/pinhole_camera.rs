//! Cameras.

use multiscopic_core::{Frame, View};

use super::{
    geometry::{Pose, Ray, Vec3},
    hash, unit,
};
use crate::lens::CameraModel;

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

    /// The position at which the stage puts the camera for a frame: millimetres to the right of the centre and below it.
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

/// A camera that stands anywhere in a scene, with a lens that may distort.
///
/// With a lens or a pose that took angles to compute, pictures may differ between machines in single grey values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosedCamera {
    /// The size and the noise of the sensor, and the focal length without a lens.
    pub sensor: PinholeCamera,
    /// The lens, with focal lengths and a principal point of its own. `None`: a pinhole.
    pub lens: Option<CameraModel>,
    /// The place of the camera, in world coordinates. Its axes are `u`, `v` and the optical axis.
    pub pose: Pose,
}

impl PosedCamera {
    /// A camera without a lens, `right` and `down` millimetres from `viewpoint` in its image plane.
    pub(super) fn beside(viewpoint: &Pose, sensor: &PinholeCamera, [right, down]: [f64; 2]) -> PosedCamera {
        PosedCamera { sensor: *sensor, lens: None, pose: viewpoint.moved([right, down, 0.0]) }
    }

    /// The ray through image point `(u, v)`. Its `t` is the depth along the optical axis in millimetres. `None` beyond the
    /// range of the lens model.
    pub fn ray(&self, u: f64, v: f64) -> Option<Ray> {
        let [x, y] = match &self.lens {
            Some(lens) => lens.direction([u, v])?,
            None => self.sensor.direction(u, v),
        };
        Some(Ray { origin: self.pose.origin, direction: self.pose.world_direction(Vec3::new(x, y, 1.0)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        lens::{Lens, LensModel},
        scene::{Finish, Lamp, Object, Placement, Scene, Shape, Texture, render_at, trace},
    };

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

    const WHITE: Texture = Texture::Plain(Vec3::splat(1.0));
    const BLACK: Texture = Texture::Plain(Vec3::ZERO);

    /// A white ball before a black wall, in the same light from all sides.
    fn ball(center: Vec3) -> Scene {
        let wall = Shape::Panel { half_width: 1e6, half_height: 1e6 };
        let object = |shape, at, texture| Object {
            shape,
            pose: Pose::at(at),
            texture,
            placement: Placement::IDENTITY,
            finish: Finish::Matte,
        };
        Scene {
            objects: vec![object(wall, Vec3::new(0.0, 0.0, 5000.0), BLACK), object(Shape::Sphere { radius: 4.0 }, center, WHITE)],
            lamp: Lamp { center: Vec3::new(0.0, 0.0, -1000.0), half_u: Vec3::X, half_v: Vec3::Y, light: Vec3::ZERO },
            sky: Vec3::splat(0.5),
            ground: Vec3::splat(0.5),
            viewpoint: Pose::at(Vec3::ZERO),
        }
    }

    /// The centre of what is bright.
    fn bright_spot(camera: &PosedCamera, scene: &Scene) -> [f64; 2] {
        let image = render_at(scene, camera, 1);
        let (mut sum, mut u, mut v) = (0.0, 0.0, 0.0);
        for (x, y, pixel) in image.enumerate_pixels() {
            // The sensor's gamma is 2.
            let light = f64::from(pixel.0[0]).powi(2);
            (sum, u, v) = (sum + light, u + light * f64::from(x), v + light * f64::from(y));
        }
        [u / sum, v / sum]
    }

    /// Balls appear where OpenCV's `projectPoints` puts their centres: the formula of the plumb bob, and rotations as matrices.
    #[test]
    fn points_appear_where_the_lens_projects_them() {
        let [k1, k2, p1, p2, k3] = [-0.25, 0.08, 0.0012, -0.0007, -0.01];
        let ([fx, fy], [cx, cy]) = ([600.0, 606.0], [322.5, 236.75]);
        let lens = Lens::new(LensModel::PlumbBob, &[k1, k2, p1, p2, k3]).unwrap();
        let lens = CameraModel { size: Some([640, 480]), focal_px: [fx, fy], principal_point: [cx, cy], lens };
        // Turned by 5 degrees about the axis to the right, then moved along its own axes.
        let (angle, moved) = (5.0_f64.to_radians(), [12.0, -7.0, 20.0]);
        let pose = Pose::at(Vec3::ZERO).rotated([angle, 0.0, 0.0]).moved(moved);
        let camera = PosedCamera { sensor: PinholeCamera::new(640, 480).ideal(), lens: Some(lens), pose };
        for world in [[0.0, 0.0, 700.0], [250.0, 130.0, 650.0], [-270.0, -190.0, 600.0], [300.0, -150.0, 800.0]] {
            // To camera coordinates: y' = y cos + z sin, z' = z cos - y sin.
            let (sin, cos) = angle.sin_cos();
            let [x, y, z] =
                [world[0] - moved[0], world[1] * cos + world[2] * sin - moved[1], world[2] * cos - world[1] * sin - moved[2]];
            let (x, y) = (x / z, y / z);
            let r2 = x * x + y * y;
            let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
            let u = fx * (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + cx;
            let v = fy * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + cy;
            let center = Vec3::new(world[0], world[1], world[2]);
            let [found_u, found_v] = bright_spot(&camera, &ball(center));
            // The rays of a pixel are up to an eighth of it off its middle in the mean.
            assert!((found_u - u).abs() < 0.2 && (found_v - v).abs() < 0.2, "({u}, {v}), found ({found_u}, {found_v})");
            // The ray through the middle of the ball ends on its near side, about a radius before its centre.
            let depth = trace(&ball(center), &[camera.ray(u, v).unwrap()])[0].unwrap();
            assert!((z - depth - 4.0).abs() < 0.5, "depth {depth} of {z}");
        }
    }

    #[test]
    fn a_lens_without_distortion_is_a_pinhole() {
        let sensor = PinholeCamera { focal_px: 60.0, ..PinholeCamera::new(48, 36) };
        let lens = CameraModel { size: None, focal_px: [60.0; 2], principal_point: [23.5, 17.5], lens: Lens::IDEAL };
        let scene = Scene::demo();
        let [pinhole, lens] = [None, Some(lens)].map(|lens| PosedCamera { sensor, lens, pose: scene.viewpoint });
        let [a, b] = [pinhole, lens].map(|camera| render_at(&scene, &camera, 5));
        let differences = a.as_raw().iter().zip(b.as_raw()).filter(|(a, b)| a.abs_diff(**b) > 1);
        assert!(differences.count() < 30);
    }

    #[test]
    fn beyond_the_lens_model_it_is_black() {
        // This plumb bob ends at a distorted radius of 0.77: pixel 77 to the right of the middle.
        let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let lens = CameraModel { size: None, focal_px: [100.0; 2], principal_point: [99.5, 19.5], lens };
        let camera = PosedCamera { sensor: PinholeCamera::new(200, 40).ideal(), lens: Some(lens), pose: Scene::demo().viewpoint };
        let image = render_at(&Scene::demo(), &camera, 0);
        assert_eq!([0, 10, 189, 199].map(|u| image.get_pixel(u, 20).0), [[0; 3]; 4]);
        assert!([40, 100, 160].into_iter().all(|u| image.get_pixel(u, 20).0 != [0; 3]));
    }
}
