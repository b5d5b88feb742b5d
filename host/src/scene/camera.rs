//! The camera and the stage that moves it: five frames of a scene, and the disparity they should give.

use super::{
    Scene,
    noise::{even_square, gaussian, hash, unit},
    trace::Tracer,
    vector::{Ray, Vec3},
};
use crate::images::{FloatImage, Frames, Picture};
use image::RgbImage;
use multiscopic_core::{Frame, View, Views};
use rayon::prelude::*;
use std::ops::Add;

/// Rays of a pixel in which surfaces meet. Others have four.
const EDGE_RAYS: u32 = 8;

/// Pixels of a row that share a search for the objects in them.
const RUN: u32 = 16;

/// A pinhole camera on a stage that moves it in its image plane. Pixel `(u, v)` has its centre at whole coordinates, and the
/// optical axis goes through the middle of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The focal length in pixels.
    pub focal_px: f64,
    /// From the centre to each neighbour, in millimetres.
    pub baseline_mm: f64,
    /// How far the stage may miss a neighbour's position in each axis, in millimetres.
    pub repeatability_mm: f64,
    /// The standard deviation of a pixel's read-out noise, in electrons.
    pub read_noise: f64,
    /// How many electrons a white pixel holds, which sets the shot noise; infinite for a sensor without noise.
    pub full_well: f64,
}

impl Camera {
    /// A camera with a 37 degree lens, the paper's baseline of 20 mm, a stage good to 0.1 mm, and a small sensor's noise.
    pub fn new(width: u32, height: u32) -> Camera {
        Camera {
            width,
            height,
            focal_px: 1.5 * f64::from(width),
            baseline_mm: 20.0,
            repeatability_mm: 0.1,
            read_noise: 6.0,
            full_well: 10_000.0,
        }
    }

    /// The same camera with a perfect sensor on a perfect stage.
    pub fn ideal(self) -> Camera {
        Camera { repeatability_mm: 0.0, read_noise: 0.0, full_well: f64::INFINITY, ..self }
    }

    /// Where the camera is for a frame, to the right of and below the centre, in millimetres.
    fn position(&self, frame: Frame, seed: u64) -> [f64; 2] {
        let Frame::View(view) = frame else { return [0.0; 2] };
        let random = |axis: u64| 2.0 * unit(hash(hash(seed) ^ hash(2 * view as u64 + axis))) - 1.0;
        let mut position = [random(0) * self.repeatability_mm, random(1) * self.repeatability_mm];
        // A match moves against the camera.
        position[usize::from(!view.is_horizontal())] -= f64::from(view.sign()) * self.baseline_mm;
        position
    }

    /// The ray through image point `(u, v)` of the camera at `position`; its unit is a millimetre of depth.
    fn ray(&self, scene: &Scene, position: [f64; 2], u: f64, v: f64) -> Ray {
        let middle = |size: u32| (f64::from(size) - 1.0) / 2.0;
        let (x, y) = ((u - middle(self.width)) / self.focal_px, (v - middle(self.height)) / self.focal_px);
        let pose = &scene.viewpoint;
        Ray {
            origin: pose.origin + pose.axes[0] * position[0] + pose.axes[1] * position[1],
            direction: pose.world_direction(Vec3::new(x, y, 1.0)),
        }
    }

    /// The light of one pixel before the sensor. Nothing but `objects` can be in it.
    fn light(&self, tracer: &Tracer, objects: &[usize], position: [f64; 2], u: u32, v: u32) -> Vec3 {
        let ray = |sample: u32| {
            let [du, dv] = even_square(sample).map(|x| x - 0.5);
            self.ray(tracer.scene, position, f64::from(u) + du, f64::from(v) + dv)
        };
        let nearest = |ray: &Ray| tracer.nearest(ray, objects.iter().copied());
        let rays = [0, 1, 2, 3].map(ray);
        let hits = rays.map(|ray| nearest(&ray));
        // The second ray goes through the middle of the pixel.
        if let [Some(_), Some(middle), Some(_), Some(_)] = &hits
            && hits.iter().flatten().all(|hit| hit.is_same_surface(middle))
        {
            // Light changes slowly over a surface, its colours do not.
            let light = tracer.illumination(&rays[1], middle);
            let samples = rays.iter().zip(hits.iter().flatten()).zip(0..);
            return samples.map(|((ray, hit), sample)| tracer.shade(ray, hit, &light, sample)).fold(Vec3::ZERO, Vec3::add) * 0.25;
        }
        let trace = |sample: u32| {
            let ray = ray(sample);
            match nearest(&ray) {
                Some(hit) => tracer.shade(&ray, &hit, &tracer.illumination(&ray, &hit), sample),
                None => tracer.surroundings(ray.direction),
            }
        };
        (0..EDGE_RAYS).map(trace).fold(Vec3::ZERO, Vec3::add) * (1.0 / f64::from(EDGE_RAYS))
    }

    /// The objects that may be in the [`RUN`] pixels of a row from `u` on.
    fn objects_in_run(&self, tracer: &Tracer, position: [f64; 2], u: u32, v: u32) -> Vec<usize> {
        let half = f64::from(RUN) / 2.0;
        let axis = self.ray(tracer.scene, position, f64::from(u) - 0.5 + half, f64::from(v));
        tracer.in_cone(axis, (half + 1.0) / self.focal_px).collect()
    }

    /// What the sensor and the camera's tone curve make of a pixel's light.
    fn develop(&self, light: Vec3, place: u64) -> [u8; 3] {
        let mut channel = 0;
        [light.x, light.y, light.z].map(|light| {
            channel += 1;
            let read = self.read_noise / self.full_well;
            let deviation = (light / self.full_well + read * read).sqrt();
            let signal = light + deviation * gaussian(hash(place ^ (channel << 56)));
            (tone(signal.max(0.0)) * 255.0 + 0.5) as u8
        })
    }
}

/// Linear light to display brightness: highlights are rolled off (a rational fit of a film curve), then a gamma of 2.
fn tone(light: f64) -> f64 {
    let film = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14);
    film.min(1.0).sqrt()
}

/// What a capture gives: five frames and the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The reference.
    pub center: RgbImage,
    /// The neighbours, in the order of [`View::ALL`].
    pub neighbors: [RgbImage; 4],
    /// The disparity of every centre pixel in pixels, row by row, for the nominal baseline and the point that the ray through
    /// the pixel's centre meets; infinite where it meets nothing.
    pub truth: FloatImage,
}

impl Shot {
    /// One of the five images.
    pub fn frame(&self, frame: Frame) -> &RgbImage {
        match frame {
            Frame::Center => &self.center,
            Frame::View(view) => &self.neighbors[view as usize],
        }
    }

    /// What the matcher sees: the centre and the neighbours `views`, in grey.
    pub fn frames(&self, views: Views) -> Frames {
        let gray = |frame| Picture::Rgb(self.frame(frame).clone()).to_gray();
        views.iter().fold(Frames::new(gray(Frame::Center)), |frames, view| frames.with(view, gray(Frame::View(view))))
    }
}

/// Takes the centre and the four neighbours of a scene. The seed decides the sensor's noise and where the stage really stops.
///
/// # Panics
/// If the camera has no pixels.
pub fn capture(scene: &Scene, camera: &Camera, seed: u64) -> Shot {
    let tracer = Tracer::new(scene);
    assert!(camera.width > 0 && camera.height > 0, "a camera of {}x{} pixels", camera.width, camera.height);
    Shot {
        center: shoot(&tracer, camera, Frame::Center, seed),
        neighbors: View::ALL.map(|view| shoot(&tracer, camera, Frame::View(view), seed)),
        truth: true_disparity(&tracer, camera),
    }
}

fn shoot(tracer: &Tracer, camera: &Camera, frame: Frame, seed: u64) -> RgbImage {
    let position = camera.position(frame, seed);
    let number = match frame {
        Frame::Center => 0,
        Frame::View(view) => 1 + view as u64,
    };
    let frame_seed = hash(seed.wrapping_mul(8).wrapping_add(number));
    let mut image = RgbImage::new(camera.width, camera.height);
    image.par_chunks_exact_mut(3 * camera.width as usize).zip(0..camera.height).for_each(|(row, v)| {
        for (run, first) in row.chunks_mut(3 * RUN as usize).zip((0..).step_by(RUN as usize)) {
            let objects = camera.objects_in_run(tracer, position, first, v);
            for (pixel, u) in run.chunks_exact_mut(3).zip(first..) {
                let place = hash(frame_seed ^ (u64::from(v) << 32 | u64::from(u)));
                pixel.copy_from_slice(&camera.develop(camera.light(tracer, &objects, position, u, v), place));
            }
        }
    });
    image
}

fn true_disparity(tracer: &Tracer, camera: &Camera) -> FloatImage {
    let (width, scale) = (camera.width as usize, camera.focal_px * camera.baseline_mm);
    let mut truth = FloatImage::filled(width, camera.height as usize, f32::INFINITY);
    truth.pixels_mut().par_chunks_exact_mut(width).zip(0..camera.height).for_each(|(row, v)| {
        for (d, u) in row.iter_mut().zip(0u32..) {
            let ray = camera.ray(tracer.scene, [0.0; 2], f64::from(u), f64::from(v));
            if let Some(hit) = tracer.nearest(&ray, tracer.all()) {
                *d = (scale / hit.t) as f32;
            }
        }
    });
    truth
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Finish, Lamp, Object, Pose, Shape, Texture};

    /// One matte object in front of a camera that looks along `z`.
    fn alone(shape: Shape, pose: Pose) -> Scene {
        Scene {
            objects: vec![Object { shape, pose, texture: Texture::Plain(Vec3::splat(0.5)), finish: Finish::Matte }],
            lamp: Lamp { center: Vec3::ZERO, half_u: Vec3::X, half_v: Vec3::Y, light: Vec3::splat(1.0) },
            viewpoint: Pose::at(Vec3::ZERO),
            ..Scene::demo()
        }
    }

    /// The image point of pixel `index` on the plane at depth 1.
    fn direction(camera: &Camera, index: usize) -> (f64, f64) {
        let (u, v) = (index % camera.width as usize, index / camera.width as usize);
        let middle = |size: u32| (f64::from(size) - 1.0) / 2.0;
        ((u as f64 - middle(camera.width)) / camera.focal_px, (v as f64 - middle(camera.height)) / camera.focal_px)
    }

    #[test]
    fn a_plane_has_the_disparity_of_its_equation() {
        // Turned about `v`: a point's depth is 900 plus a share of its x.
        let camera = Camera::new(48, 32).ideal();
        let pose = Pose::at(Vec3::new(0.0, 0.0, 900.0)).turned(1, 0.2);
        let normal = pose.axes[2];
        let shot = capture(&alone(Shape::Panel { half_width: 1e9, half_height: 1e9 }, pose), &camera, 3);
        for (index, &d) in shot.truth.pixels().iter().enumerate() {
            let (x, y) = direction(&camera, index);
            // The disparity of a plane is linear in the image.
            let expected = camera.focal_px * camera.baseline_mm * (normal.x * x + normal.y * y + normal.z) / (normal.z * 900.0);
            assert!((f64::from(d) - expected).abs() < 1e-5 * expected, "pixel {index}: {d}, expected {expected}");
        }
    }

    #[test]
    fn a_sphere_has_the_disparity_of_its_near_side_and_nothing_around() {
        let camera = Camera::new(64, 48).ideal();
        let (center, radius) = (Vec3::new(20.0, -30.0, 700.0), 90.0);
        let shot = capture(&alone(Shape::Sphere { radius }, Pose::at(center)), &camera, 3);
        let mut hits = 0;
        for (index, &d) in shot.truth.pixels().iter().enumerate() {
            let (x, y) = direction(&camera, index);
            // |z (x, y, 1) - center| = radius, solved for z.
            let a = x * x + y * y + 1.0;
            let b = x * center.x + y * center.y + center.z;
            let root = b * b - a * (center.dot(center) - radius * radius);
            if root < 0.0 {
                assert!(d.is_infinite(), "pixel {index}: {d} beside the sphere");
            } else {
                hits += 1;
                let expected = camera.focal_px * camera.baseline_mm * a / (b - root.sqrt());
                assert!((f64::from(d) - expected).abs() < 1e-5 * expected, "pixel {index}: {d}, expected {expected}");
            }
        }
        assert!((300..700).contains(&hits), "{hits} pixels see the sphere");
    }

    /// The grey value of an image between pixels, or `None` outside.
    fn grey_at(image: &RgbImage, u: f64, v: f64) -> Option<f64> {
        let inside = u >= 0.0 && v >= 0.0 && u <= f64::from(image.width() - 2) && v <= f64::from(image.height() - 2);
        let grey = |x: u32, y: u32| image[(x, y)].0.map(f64::from).iter().sum::<f64>() / 3.0;
        let (x, y) = (u.floor(), v.floor());
        let row = |y: u32| grey(x as u32, y) * (1.0 + x - u) + grey(x as u32 + 1, y) * (u - x);
        inside.then(|| row(y as u32) * (1.0 + y - v) + row(y as u32 + 1) * (v - y))
    }

    /// The median grey difference between the centre and its match in a view, with `shift` added to the true disparity.
    fn residual(shot: &Shot, view: View, shift: f64) -> f64 {
        let width = shot.center.width() as usize;
        let mut differences: Vec<f64> = (0..shot.truth.pixels().len())
            .filter_map(|index| {
                let (u, v) = ((index % width) as f64, (index / width) as f64);
                let step = f64::from(view.sign()) * (f64::from(shot.truth.pixels()[index]) + shift);
                let (x, y) = if view.is_horizontal() { (u + step, v) } else { (u, v + step) };
                Some((grey_at(&shot.center, u, v)? - grey_at(shot.frame(Frame::View(view)), x, y)?).abs())
            })
            .collect();
        differences.sort_by(f64::total_cmp);
        differences[differences.len() / 2]
    }

    #[test]
    fn the_true_disparity_finds_the_same_colour_in_every_view() {
        let shot = capture(&Scene::demo(), &Camera::new(240, 180).ideal(), 0);
        for view in View::ALL {
            let [exact, less, more] = [0.0, -2.0, 2.0].map(|shift| residual(&shot, view, shift));
            assert!(exact < 2.5, "{view:?}: median difference {exact}");
            assert!(less > 3.0 * exact && more > 3.0 * exact, "{view:?}: {exact}, 2 px off {less} and {more}");
        }
    }

    #[test]
    fn the_seed_decides_every_byte() {
        let camera = Camera::new(40, 30);
        let scene = Scene::demo();
        let first = capture(&scene, &camera, 7);
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(first, one_thread.install(|| capture(&scene, &camera, 7)));
        let other = capture(&scene, &camera, 8);
        assert_eq!(first.truth, other.truth);
        assert_ne!(first.center, other.center);
    }

    /// Any machine must make these bytes. A change of the scene changes the number too.
    #[test]
    fn bytes_are_the_same_on_every_machine() {
        let shot = capture(&Scene::demo(), &Camera::new(64, 48), 1);
        let frames = std::iter::once(&shot.center).chain(&shot.neighbors).flat_map(|image| image.as_raw().iter().copied());
        let truth = shot.truth.pixels().iter().flat_map(|d| d.to_bits().to_le_bytes());
        assert_eq!(frames.chain(truth).fold(0, |sum, byte| hash(sum ^ u64::from(byte))), 11_751_516_164_657_235_580);
    }

    #[test]
    fn the_stage_stops_near_its_targets() {
        let camera = Camera::new(64, 48);
        let mut farthest: f64 = 0.0;
        for seed in 0..200 {
            for view in View::ALL {
                let [x, y] = camera.position(Frame::View(view), seed);
                let [ideal_x, ideal_y] = camera.ideal().position(Frame::View(view), seed);
                assert_eq!(ideal_x.abs() + ideal_y.abs(), 20.0);
                farthest = farthest.max((x - ideal_x).abs()).max((y - ideal_y).abs());
            }
            assert_eq!(camera.position(Frame::Center, seed), [0.0, 0.0]);
        }
        assert!(farthest > 0.09 && farthest <= 0.1, "{farthest}");
        assert_eq!(camera.ideal().position(Frame::View(View::Top), 0), [0.0, -20.0]);
        assert_eq!(camera.ideal().position(Frame::View(View::Right), 0), [20.0, 0.0]);
    }
}
