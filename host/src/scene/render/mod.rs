//! Rendering the frames of a scene and its true disparities.

mod rays;
mod tracer;

use std::ops::Add;

use image::{GrayImage, RgbImage};
use multiscopic_core::{Frame, SweepOffset, View, Views};
use rayon::prelude::*;

use self::rays::{RUN, Rays};
use super::{
    description::{Scene, Shot},
    geometry::{Pose, Ray, Vec3},
    hash,
    pinhole_camera::{PinholeCamera, PosedCamera, frame_number},
};
use crate::images::{FloatImage, Picture, Raster};

pub use self::{
    rays::{Quality, develop},
    tracer::Tracer,
};

/// Renders the centre and the four neighbours of a scene. The seed decides the sensor's noise and where
/// exactly the stage stops.
///
/// # Panics
/// If the camera has no pixels.
pub fn render(scene: &Scene, camera: &PinholeCamera, seed: u64) -> Shot {
    render_views(scene, camera, Views::CROSS, seed)
}

/// Renders the centre and the neighbours `views` of a scene, as [`render`] does. A frame is the same whatever the others are.
///
/// # Panics
/// If the camera has no pixels.
pub fn render_views(scene: &Scene, camera: &PinholeCamera, views: Views, seed: u64) -> Shot {
    let tracer = Tracer::new(scene, Quality::Fine);
    assert!(camera.width > 0 && camera.height > 0, "a camera of {}x{} pixels", camera.width, camera.height);
    Shot {
        center: render_frame(&tracer, camera, Frame::Center, seed),
        neighbors: views.iter().map(|view| (view, render_frame(&tracer, camera, Frame::View(view), seed))).collect(),
        truth: true_disparity(&tracer, camera),
    }
}

/// Renders the grey frames of a sweep: the centre, and `steps` frames to each side, nearest first, of two the right one first. The
/// farthest are a baseline away.
///
/// # Panics
/// If the camera has no pixels, or `steps` is not from 1 to [`View::MAX_OFFSET`].
pub fn render_sweep(scene: &Scene, camera: &PinholeCamera, steps: i8, seed: u64) -> (GrayImage, Vec<(SweepOffset, GrayImage)>) {
    assert!((1..=View::MAX_OFFSET).contains(&steps), "{steps} steps");
    let tracer = Tracer::new(scene, Quality::Fine);
    let camera = PinholeCamera { baseline_mm: camera.baseline_mm / f64::from(steps), ..*camera };
    let gray = |frame| Picture::Rgb(render_frame(&tracer, &camera, frame, seed)).to_gray();
    let frames = (1..=steps).flat_map(|step| [step, -step]).map(|step| {
        let (view, bits) = (View::new(step, 0), i32::from(step) * SweepOffset::STEPS / i32::from(steps));
        (SweepOffset::from_bits(bits).expect("at most a baseline"), gray(Frame::View(view.expect("at most as far as views"))))
    });
    (gray(Frame::Center), frames.collect())
}

/// Renders what a camera sees of a scene: black where its lens sees nothing. The seed decides the sensor's noise.
pub fn render_at(scene: &Scene, camera: &PosedCamera, seed: u64) -> RgbImage {
    render_moving(scene, camera, |_| vec![camera.pose], seed)
}

/// Renders what a camera sees of a scene while it moves, as [`render_at`] does: each row is the mean of what it sees from the
/// places that `poses` gives for the row.
pub fn render_moving(scene: &Scene, camera: &PosedCamera, poses: impl Fn(u32) -> Vec<Pose> + Sync, seed: u64) -> RgbImage {
    render_image(&Tracer::new(scene, Quality::Fine), camera, poses, hash(seed))
}

fn render_frame(tracer: &Tracer, camera: &PinholeCamera, frame: Frame, seed: u64) -> RgbImage {
    let number = frame_number(frame);
    let frame_seed = match number {
        0..8 => hash(seed.wrapping_mul(8).wrapping_add(number)),
        // Eight frames have seeds beside those of the next scene.
        _ => hash(hash(seed) ^ number << 32),
    };
    let camera = PosedCamera::beside(&tracer.scene.viewpoint, camera, camera.position(frame, seed));
    render_image(tracer, &camera, |_| vec![camera.pose], frame_seed)
}

fn render_image(tracer: &Tracer, camera: &PosedCamera, poses: impl Fn(u32) -> Vec<Pose> + Sync, seed: u64) -> RgbImage {
    let PinholeCamera { width, height, .. } = camera.sensor;
    let rays = Rays::new(camera);
    let mut image = RgbImage::new(width, height);
    image.par_chunks_exact_mut(3 * width as usize).zip(0..height).for_each(|(row, v)| {
        let poses = poses(v);
        let mut sums = vec![Vec3::ZERO; width as usize];
        for pose in &poses {
            let rays = rays.at(*pose);
            sums.iter_mut().zip(light_of_row(tracer, &rays, width, v)).for_each(|(sum, light)| *sum = *sum + light);
        }
        for ((pixel, sum), u) in row.chunks_exact_mut(3).zip(sums).zip(0..) {
            let light = if poses.len() == 1 { sum } else { sum * (1.0 / poses.len() as f64) };
            pixel.copy_from_slice(&develop(&camera.sensor, light, pixel_hash(seed, u, v)));
        }
    });
    image
}

/// The random number that decides the noise of pixel `(u, v)`.
pub fn pixel_hash(seed: u64, u: u32, v: u32) -> u64 {
    hash(seed ^ (u64::from(v) << 32 | u64::from(u)))
}

/// The light that falls on every pixel of the sensor.
pub fn light_image(tracer: &Tracer, camera: &PosedCamera) -> Raster<Vec3> {
    let PinholeCamera { width, height, .. } = camera.sensor;
    let rays = Rays::new(camera);
    let row = |v: u32| light_of_row(tracer, &rays, width, v).collect::<Vec<_>>();
    let pixels = (0..height).into_par_iter().flat_map_iter(row).collect();
    Raster::new(width as usize, height as usize, pixels)
}

/// The light that falls on the pixels of row `v`.
fn light_of_row(tracer: &Tracer, rays: &Rays, width: u32, v: u32) -> impl Iterator<Item = Vec3> {
    (0..width).step_by(RUN as usize).flat_map(move |first| {
        let objects = objects_in_run(tracer, rays, first, v);
        (first..width.min(first + RUN)).map(move |u| light(tracer, rays, &objects, u, v))
    })
}

/// The objects that the [`RUN`] pixels of row `v` from column `u` on may see.
fn objects_in_run(tracer: &Tracer, rays: &Rays, u: u32, v: u32) -> Vec<usize> {
    let (left, half, v) = (f64::from(u) - 0.5, f64::from(RUN) / 2.0, f64::from(v));
    let corners = [(0.0, -0.5), (0.0, 0.5), (2.0, -0.5), (2.0, 0.5)].map(|(i, j)| rays.ray(left + i * half, v + j));
    match (rays.ray(left + half, v), corners) {
        (Some(axis), [Some(a), Some(b), Some(c), Some(d)]) => {
            let aside = |corner: Ray| (corner.direction - axis.direction).length();
            let farthest = [a, b, c, d].map(aside).into_iter().fold(0.0, f64::max);
            // The factor allows for the curved edges of what a lens shows as a rectangle.
            tracer.in_cone(axis, 1.2 * farthest).collect()
        }
        // The lens model ends within the run.
        _ => tracer.all().collect(),
    }
}

/// The light that falls on one pixel of the sensor. `objects` are all that it may see.
fn light(tracer: &Tracer, camera: &Rays, objects: &[usize], u: u32, v: u32) -> Vec3 {
    let quality = tracer.quality;
    let ray = |sample: u32| {
        let [du, dv] = quality.place(sample);
        camera.ray(f64::from(u) + du, f64::from(v) + dv)
    };
    let nearest = |ray: &Ray| tracer.nearest(ray, objects.iter().copied());
    let count = quality.surface_rays();
    let mut samples = [None; Quality::MAX_SURFACE_RAYS];
    for (sample, number) in samples.iter_mut().zip(0..count) {
        let Some(ray) = ray(number) else { return Vec3::ZERO };
        *sample = nearest(&ray).map(|hit| (ray, hit));
    }
    let hits = || samples.iter().flatten();
    if let Some((ray, middle)) = &samples[1]
        && hits().count() == count as usize
        && hits().all(|(_, hit)| hit.is_same_surface(middle))
    {
        // Light changes slowly across a surface, but texture does not: one lighting computation serves all
        // rays.
        let light = tracer.illumination(ray, middle);
        let shades = hits().zip(0..).map(|((ray, hit), sample)| tracer.shade(ray, hit, &light, sample));
        return shades.fold(Vec3::ZERO, Vec3::add) * (1.0 / f64::from(count));
    }
    let trace = |sample: u32| {
        let Some(ray) = ray(sample) else { return Vec3::ZERO };
        match nearest(&ray) {
            Some(hit) => tracer.shade(&ray, &hit, &tracer.illumination(&ray, &hit), sample),
            None => tracer.ambient(ray.direction),
        }
    };
    let rays = quality.edge_rays();
    (0..rays).map(trace).fold(Vec3::ZERO, Vec3::add) * (1.0 / f64::from(rays))
}

/// The disparities of what the rays through the middles of the centre's pixels meet.
pub fn true_disparity(tracer: &Tracer, camera: &PinholeCamera) -> FloatImage {
    let [width, height] = [camera.width, camera.height].map(|side| side as usize);
    let center = PosedCamera::beside(&tracer.scene.viewpoint, camera, [0.0; 2]);
    let scale = camera.focal_px * camera.baseline_mm;
    let disparity = |k: usize| {
        let ray = center.ray((k % width) as f64, (k / width) as f64);
        let hit = ray.and_then(|ray| tracer.nearest(&ray, tracer.all()));
        hit.map_or(f32::INFINITY, |hit| (scale / hit.t) as f32)
    };
    FloatImage::new(width, height, (0..width * height).into_par_iter().map(disparity).collect())
}

/// Returns the length of each ray up to the surface that it meets, in units of its direction. `None` if it meets none.
pub fn trace(scene: &Scene, rays: &[Ray]) -> Vec<Option<f64>> {
    let tracer = Tracer::new(scene, Quality::Fine);
    rays.par_iter().map(|ray| tracer.nearest(ray, tracer.all()).map(|hit| hit.t)).collect()
}

#[cfg(test)]
mod tests {
    use multiscopic_core::View;

    use super::*;
    use crate::scene::{Finish, Lamp, Object, Placement, Shape, Texture};

    /// A scene of one matte object, seen along `z`.
    fn scene_of(shape: Shape, pose: Pose) -> Scene {
        Scene {
            objects: vec![Object {
                shape,
                pose,
                texture: Texture::Plain(Vec3::splat(0.5)),
                placement: Placement::IDENTITY,
                finish: Finish::Matte,
            }],
            lamp: Lamp { center: Vec3::ZERO, half_u: Vec3::X, half_v: Vec3::Y, light: Vec3::splat(1.0) },
            viewpoint: Pose::at(Vec3::ZERO),
            ..Scene::demo()
        }
    }

    /// The image point of pixel `index` on the plane at depth 1.
    fn direction(camera: &PinholeCamera, index: usize) -> (f64, f64) {
        let (u, v) = (index % camera.width as usize, index / camera.width as usize);
        let middle = |size: u32| (f64::from(size) - 1.0) / 2.0;
        ((u as f64 - middle(camera.width)) / camera.focal_px, (v as f64 - middle(camera.height)) / camera.focal_px)
    }

    #[test]
    fn the_disparity_of_a_plane_is_exact() {
        // Turned about `v`, so that depth varies with x.
        let camera = PinholeCamera::new(48, 32).ideal();
        let pose = Pose::at(Vec3::new(0.0, 0.0, 900.0)).turned(1, 0.2);
        let normal = pose.axes[2];
        let shot = render(&scene_of(Shape::Panel { half_width: 1e9, half_height: 1e9 }, pose), &camera, 3);
        for (index, &d) in shot.truth.pixels().iter().enumerate() {
            let (x, y) = direction(&camera, index);
            // The disparity of a plane is linear in the image.
            let expected = camera.focal_px * camera.baseline_mm * (normal.x * x + normal.y * y + normal.z) / (normal.z * 900.0);
            assert!((f64::from(d) - expected).abs() < 1e-5 * expected, "pixel {index}: {d}, expected {expected}");
        }
    }

    #[test]
    fn the_disparity_of_a_sphere_is_that_of_its_near_side() {
        let camera = PinholeCamera::new(64, 48).ideal();
        let (center, radius) = (Vec3::new(20.0, -30.0, 700.0), 90.0);
        let shot = render(&scene_of(Shape::Sphere { radius }, Pose::at(center)), &camera, 3);
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

    /// The grey value between pixels, by bilinear interpolation; `None` outside the image.
    fn grey_at(image: &RgbImage, u: f64, v: f64) -> Option<f64> {
        let inside = u >= 0.0 && v >= 0.0 && u <= f64::from(image.width() - 2) && v <= f64::from(image.height() - 2);
        let grey = |x: u32, y: u32| image[(x, y)].0.map(f64::from).iter().sum::<f64>() / 3.0;
        let (x, y) = (u.floor(), v.floor());
        let row = |y: u32| grey(x as u32, y) * (1.0 + x - u) + grey(x as u32 + 1, y) * (u - x);
        inside.then(|| row(y as u32) * (1.0 + y - v) + row(y as u32 + 1) * (v - y))
    }

    /// The median grey difference between centre pixels and their matches in a view, at the true disparity
    /// plus `shift`.
    fn residual(shot: &Shot, view: View, shift: f64) -> f64 {
        let width = shot.center.width() as usize;
        let mut differences: Vec<f64> = (0..shot.truth.pixels().len())
            .filter_map(|index| {
                let (u, v) = ((index % width) as f64, (index / width) as f64);
                let (du, dv) = view.shift(1);
                let d = f64::from(shot.truth.pixels()[index]) + shift;
                let (x, y) = (u + f64::from(du) * d, v + f64::from(dv) * d);
                Some((grey_at(&shot.center, u, v)? - grey_at(shot.frame(Frame::View(view)), x, y)?).abs())
            })
            .collect();
        differences.sort_by(f64::total_cmp);
        differences[differences.len() / 2]
    }

    #[test]
    fn the_true_disparity_finds_the_same_colour_in_every_view() {
        let elsewhere = [(1, -1), (-3, 0)].map(|(right, down)| View::new(right, down).unwrap());
        let views = elsewhere.into_iter().fold(Views::CROSS, Views::with);
        let shot = render_views(&Scene::demo(), &PinholeCamera::new(240, 180).ideal(), views, 0);
        for view in views.iter() {
            let [exact, less, more] = [0.0, -2.0, 2.0].map(|shift| residual(&shot, view, shift));
            assert!(exact < 2.5, "{view:?}: median difference {exact}");
            assert!(less > 3.0 * exact && more > 3.0 * exact, "{view:?}: {exact}, 2 px off {less} and {more}");
        }
    }

    #[test]
    fn the_seed_decides_every_byte() {
        let camera = PinholeCamera::new(40, 30);
        let scene = Scene::demo();
        let first = render(&scene, &camera, 7);
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(first, one_thread.install(|| render(&scene, &camera, 7)));
        let other = render(&scene, &camera, 8);
        assert_eq!(first.truth, other.truth);
        assert_ne!(first.center, other.center);
    }

    /// The number is the hash of these bytes on every machine. It changes only with the scene.
    #[test]
    fn bytes_are_the_same_on_every_machine() {
        let shot = render(&Scene::demo(), &PinholeCamera::new(64, 48), 1);
        let frames = std::iter::once(&shot.center)
            .chain(View::CROSS.map(|view| &shot.neighbors[&view]))
            .flat_map(|image| image.as_raw().iter().copied());
        let truth = shot.truth.pixels().iter().flat_map(|d| d.to_bits().to_le_bytes());
        assert_eq!(frames.chain(truth).fold(0, |sum, byte| hash(sum ^ u64::from(byte))), 11_751_516_164_657_235_580);
    }
}
