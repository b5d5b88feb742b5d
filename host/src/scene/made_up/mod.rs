//! Random scenes and the rigs that capture them, in any number, each known by its seed and number.
//!
//! Sizes on the image are in *nominal* pixels, of which an image is [`NOMINAL_WIDTH`] wide: a scene is the same whatever the
//! size of its pictures, and its disparities grow with their width.

mod coatings;
mod flaws;
mod objects;

use image::RgbImage;
use multiscopic_core::{Frame, Views};

use super::{
    description::{Finish, Scene, Shot},
    geometry::Vec3,
    hash,
    pinhole_camera::{PinholeCamera, frame_number},
    render::{Quality, Tracer, develop, light_image, pixel_hash, true_disparity},
};
use crate::images::Raster;

use coatings::Coatings;
use flaws::Dice;
use objects::{NOMINAL_WIDTH, Viewport, backdrop, foreground, illumination};

pub use coatings::{ObjectKind, Setting};
pub use flaws::Flaws;

/// A random scene, and a rig that captures it more or less well.
///
/// Everything follows from a seed and a number, with the same bytes on every machine. Disparities fill a random part of about 1
/// to 30 pixels in images that are 256 pixels wide, and of proportionally more in wider ones.
///
/// ```
/// use multiscopic::scene::RandomScene;
/// use multiscopic_core::Views;
/// let shot = RandomScene::new(1, 0, [64, 48]).render(Views::CROSS);
/// let frames = shot.color_frames();
/// assert_eq!((frames.size(), frames.views()), ([64, 48], Views::CROSS));
/// assert!(shot.truth.pixels().iter().all(|d| (0.1..9.0).contains(d)));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RandomScene {
    /// The objects and their light.
    pub scene: Scene,
    /// The camera, its noise, and the stage that carries it.
    pub camera: PinholeCamera,
    /// The other flaws of the rig.
    pub flaws: Flaws,
    /// The mean of the square root of the light in the centre frame, where white is 1.
    pub brightness: f64,
}

impl RandomScene {
    /// Scene `number` of those of a seed, for pictures of `size`, in the field. The scene does not depend on the width, only on
    /// the ratio of width and height.
    ///
    /// # Panics
    /// If the width or the height is 0.
    pub fn new(seed: u64, number: u64, size: [u32; 2]) -> RandomScene {
        RandomScene::within(Setting::Field, seed, number, size)
    }

    /// The same in any setting.
    ///
    /// # Panics
    /// If the width or the height is 0.
    pub fn within(setting: Setting, seed: u64, number: u64, size: [u32; 2]) -> RandomScene {
        RandomScene::of_kinds(setting, &[], seed, number, size)
    }

    /// The same with objects of these kinds alone before the backdrop, which may be anything; with objects of any kind if there
    /// are none.
    ///
    /// # Panics
    /// If the width or the height is 0.
    pub fn of_kinds(setting: Setting, kinds: &[ObjectKind], seed: u64, number: u64, size: [u32; 2]) -> RandomScene {
        assert!(size[0] > 0 && size[1] > 0, "pictures of {}x{} pixels", size[0], size[1]);
        let mut dice = Dice::new(hash(seed) ^ hash(!number));
        let viewport = random_viewport(&mut dice, size);
        let coatings = Coatings::new(&mut dice, setting);
        let mut objects = backdrop(&mut dice, &viewport, &coatings);
        let (lamp, [sky, ground]) = illumination(&mut dice, &viewport, &objects);
        objects.extend(foreground(&mut dice, &viewport, &coatings, kinds));
        let (camera, flaws) = rig(&mut dice, &viewport, setting, size);
        let brightness = dice.between(0.25, 0.6);
        RandomScene { scene: Scene { objects, lamp, sky, ground, viewpoint: Viewport::pose() }, camera, flaws, brightness }
    }

    /// The same scene with matte surfaces only, and with a rig without noise, whose views are where they should be and equally
    /// bright. They are as blurred as they were.
    pub fn ideal(mut self) -> RandomScene {
        self.scene.objects.iter_mut().for_each(|object| object.finish = Finish::Matte);
        let flaws = Flaws { blur: self.flaws.blur, blurs: self.flaws.blurs, ..Flaws::NONE };
        RandomScene { camera: self.camera.ideal(), flaws, ..self }
    }

    /// Renders the centre, the neighbours `views`, and the true disparities that an ideal rig would find. A frame is the same
    /// whatever the others are.
    pub fn render(&self, views: Views) -> Shot {
        let tracer = Tracer::new(&self.scene, Quality::Quick);
        let light = |frame| light_image(&tracer, &self.flaws.camera(&self.scene.viewpoint, &self.camera, frame));
        let center = light(Frame::Center);
        let mean = center.pixels().iter().map(|light| luminance(*light).sqrt()).sum::<f64>() / center.pixels().len() as f64;
        let exposure = self.brightness * self.brightness / (mean * mean).max(1e-9);
        let picture = |mut light: Raster<Vec3>, frame| {
            self.flaws.expose(&mut light, frame, exposure);
            self.develop(&light, frame)
        };
        Shot {
            neighbors: views.iter().map(|view| (view, picture(light(Frame::View(view)), Frame::View(view)))).collect(),
            center: picture(center, Frame::Center),
            truth: true_disparity(&tracer, &self.camera),
        }
    }

    fn develop(&self, light: &Raster<Vec3>, frame: Frame) -> RgbImage {
        let seed = hash(hash(self.flaws.seed) ^ hash(frame_number(frame)));
        let PinholeCamera { width, height, .. } = self.camera;
        let pixel = |u: u32, v: u32| develop(&self.camera, light.get(u as usize, v as usize), pixel_hash(seed, u, v)).into();
        RgbImage::from_fn(width, height, pixel)
    }
}

fn luminance(light: Vec3) -> f64 {
    light.dot(Vec3::new(0.3, 0.59, 0.11))
}

/// A camera, the baseline, and the range of disparities.
fn random_viewport(dice: &mut Dice, size: [u32; 2]) -> Viewport {
    let focal = NOMINAL_WIDTH * dice.between(1.0, 1.8);
    let far = dice.mostly_low(1.2, 10.0);
    let near = dice.between(far + 3.0, 30.0);
    // How many millimetres a pixel shows of what is nearest: its disparity is the baseline in those.
    let footprint = dice.between(0.6, 1.6);
    Viewport { focal, half: Viewport::half_of(size), baseline_mm: near * footprint, far, near }
}

/// The rig that captures what is in view.
fn rig(dice: &mut Dice, viewport: &Viewport, setting: Setting, [width, height]: [u32; 2]) -> (PinholeCamera, Flaws) {
    let (misaligned, most_misaligned, gains, blur) = match setting {
        Setting::Field => (0.35, 0.6, [0.0, 0.01, 0.03, 0.08], [0.2, 0.5]),
        Setting::Studio => (0.15, 0.3, [0.0, 0.0, 0.01, 0.03], [0.05, 0.35]),
    };
    let misalignment = if dice.happens(misaligned) { dice.between(0.05, most_misaligned) } else { 0.0 };
    let pixel = f64::from(width) / NOMINAL_WIDTH;
    let camera = PinholeCamera {
        width,
        height,
        focal_px: viewport.focal * pixel,
        baseline_mm: viewport.baseline_mm,
        // Half of what is misaligned are the positions: of the nearest things, a pixel is the baseline through their disparity.
        repeatability_mm: 0.5 * misalignment * viewport.baseline_mm / viewport.near,
        read_noise: dice.mostly_low(1.0, 8.0),
        full_well: match setting {
            Setting::Field => 1.0 / dice.mostly_low(1e-5, 1.2e-3),
            Setting::Studio => {
                let noise = dice.mostly_low(0.1, 1.0);
                2500.0 / (noise * noise)
            }
        },
    };
    let flaws = Flaws {
        seed: dice.bits(),
        turned_px: misalignment * pixel,
        gain: dice.pick(gains),
        stray: [dice.mostly_low(0.001, 0.03), dice.pick([0.0, 0.001, 0.004])],
        blur: dice.between(blur[0], blur[1]),
        blurs: dice.pick([1, 1, 1, 2]),
    };
    (camera, flaws)
}

#[cfg(test)]
mod tests {
    use std::{collections::HashSet, mem};

    use multiscopic_core::View;

    use super::*;
    use crate::{
        images::FloatImage,
        scene::{description::Object, pinhole_camera::PosedCamera, texture::Texture},
    };

    /// The grey value between pixels, by bilinear interpolation.
    fn gray_at(image: &RgbImage, [x, y]: [f64; 2]) -> f64 {
        let gray = |u: f64, v: f64| image.get_pixel(u as u32, v as u32).0.map(f64::from).iter().sum::<f64>() / 3.0;
        let (u, v) = (x.floor(), y.floor());
        let row = |v: f64| gray(u, v) * (1.0 + u - x) + gray(u + 1.0, v) * (x - u);
        row(v) * (1.0 + v - y) + row(v + 1.0) * (y - v)
    }

    /// Returns true if a pixel and its neighbours at a distance of up to 2 are on one surface, as far as their disparities
    /// tell.
    fn is_smooth(truth: &FloatImage, u: usize, v: usize) -> bool {
        let d = truth.get(u, v);
        (v - 2..=v + 2).all(|v| (u - 2..=u + 2).all(|u| (truth.get(u, v) - d).abs() < 0.6))
    }

    /// The mean grey difference between centre pixels and their matches in a view at the true disparity plus `shift`. It skips
    /// edges, what something nearer hides, and the borders, where something that the centre does not see may hide it.
    fn residual(shot: &Shot, view: View, shift: f64) -> f64 {
        let truth = &shot.truth;
        let (dx, dy) = (f64::from(view.right()), f64::from(view.down()));
        let at = |u: usize, v: usize, d: f64| [u as f64 - dx * d, v as f64 - dy * d];
        let most = truth.pixels().iter().fold(0.0, |most: f32, d| most.max(*d)).ceil() as usize + 3;
        let [across, down] = [dx, dy].map(|offset| if offset == 0.0 { 3 } else { most });
        let (columns, rows) = (across..truth.width() - across, down..truth.height() - down);
        let pixels = || rows.clone().flat_map(|v| columns.clone().map(move |u| (u, v)));
        let is_hidden = |u: usize, v: usize| {
            let d = f64::from(truth.get(u, v));
            let [x, y] = at(u, v, d);
            // What lands on the same place lies on the same line.
            (-(most as isize)..=most as isize).any(|step| {
                let (u, v) = ((u as isize + step * dx as isize) as usize, (v as isize + step * dy as isize) as usize);
                (-1..=1).any(|aside| {
                    let (u, v) = (u as isize + aside * dy.abs() as isize, v as isize + aside * dx.abs() as isize);
                    if u < 0 || v < 0 || u as usize >= truth.width() || v as usize >= truth.height() {
                        return false;
                    }
                    let other = f64::from(truth.get(u as usize, v as usize));
                    let [ox, oy] = at(u as usize, v as usize, other);
                    other > d + 0.6 && (ox - x).abs() < 2.5 && (oy - y).abs() < 2.5
                })
            })
        };
        let seen: Vec<_> = pixels().filter(|&(u, v)| is_smooth(truth, u, v) && !is_hidden(u, v)).collect();
        assert!(seen.len() > 100, "{} pixels", seen.len());
        let difference = |&(u, v): &(usize, usize)| {
            let there = gray_at(shot.frame(Frame::View(view)), at(u, v, f64::from(truth.get(u, v)) + shift));
            (gray_at(&shot.center, [u as f64, v as f64]) - there).abs()
        };
        seen.iter().map(difference).sum::<f64>() / seen.len() as f64
    }

    #[test]
    fn the_true_disparity_finds_the_same_grey_in_every_view() {
        let views = [View::RIGHT, View::TOP];
        for number in 0..4 {
            let shot = RandomScene::new(5, number, [128, 96]).ideal().render(views.into_iter().collect());
            for view in views {
                let [exact, less, more] = [0.0, -1.0, 1.0].map(|shift| residual(&shot, view, shift));
                assert!(exact < 2.5, "scene {number}, {view} view: {exact} grey levels");
                assert!(exact < 0.5 * less.min(more), "scene {number}, {view} view: {exact}, a pixel off {less} and {more}");
            }
        }
    }

    #[test]
    fn a_frame_depends_on_its_scene_alone() {
        let random = RandomScene::new(2, 7, [40, 30]);
        let cross = random.render(Views::CROSS);
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let stereo = one_thread.install(|| RandomScene::new(2, 7, [40, 30]).render(Views::STEREO));
        assert_eq!((&cross.center, &cross.truth), (&stereo.center, &stereo.truth));
        assert_eq!(cross.neighbors[&View::RIGHT], stereo.neighbors[&View::RIGHT]);
        for (seed, number) in [(2, 8), (3, 7), (7, 2)] {
            assert_ne!(RandomScene::new(seed, number, [40, 30]).scene, random.scene);
        }
    }

    /// The middle of a pixel is the middle of that in the middle of three by three smaller ones.
    #[test]
    fn a_scene_does_not_depend_on_the_width() {
        let none = Views::NONE;
        for number in 0..3 {
            let [small, large] = [[24, 18], [72, 54]].map(|size| RandomScene::new(4, number, size).render(none).truth);
            for (u, v) in (0..18).flat_map(|v| (0..24).map(move |u| (u, v))) {
                let [small, large] = [small.get(u, v), large.get(3 * u + 1, 3 * v + 1)];
                assert!((large - 3.0 * small).abs() < 1e-4 * large, "scene {number} at ({u}, {v}): {small} and {large}");
            }
        }
    }

    #[test]
    fn scenes_differ_in_everything_and_every_pixel_has_a_truth() {
        let (mut shapes, mut finishes, mut textures) = (HashSet::new(), HashSet::new(), HashSet::new());
        let (mut nearest, mut farthest, mut misaligned) = (Vec::new(), Vec::new(), 0);
        for number in 0..150 {
            let random = RandomScene::new(8, number, [32, 24]);
            for Object { shape, texture, finish, .. } in &random.scene.objects {
                shapes.insert(mem::discriminant(shape));
                finishes.insert(mem::discriminant(finish));
                textures.insert(mem::discriminant(texture));
            }
            misaligned += u32::from(random.flaws.turned_px > 0.0);
            let truth = random.render(Views::NONE).truth;
            // In an image that is 256 pixels wide.
            let disparities = || truth.pixels().iter().map(|d| 8.0 * d);
            let (least, greatest) = (disparities().fold(f32::INFINITY, f32::min), disparities().fold(0.0, f32::max));
            assert!(least > 0.5 && greatest < 33.0, "scene {number}: {least} to {greatest}");
            nearest.push(greatest);
            farthest.push(least);
        }
        assert_eq!((shapes.len(), finishes.len(), textures.len()), (4, 4, 12));
        assert!((30..80).contains(&misaligned), "{misaligned} rigs are misaligned");
        for (values, low, high) in [(nearest, 9.0, 24.0), (farthest, 2.0, 7.0)] {
            let [below, above] = [values.iter().filter(|d| **d < low).count(), values.iter().filter(|d| **d > high).count()];
            assert!(below > 10 && above > 10, "{below} below {low}, {above} above {high}");
        }
    }

    /// A scene of objects of one kind, as an exact rig without noise captures it, and the objects that the pixels of the centre and
    /// of the right view show.
    fn of_kind(kind: ObjectKind, number: u64) -> (RandomScene, Shot, [Raster<usize>; 2]) {
        let random = RandomScene::of_kinds(Setting::Field, &[kind], 6, number, [256, 192]);
        let flaws = Flaws { blur: random.flaws.blur, blurs: random.flaws.blurs, ..Flaws::NONE };
        let exact = RandomScene { camera: random.camera.ideal(), flaws, ..random };
        let tracer = Tracer::new(&exact.scene, Quality::Quick);
        let shown = [0.0, exact.camera.baseline_mm].map(|right| {
            let camera = PosedCamera::beside(&exact.scene.viewpoint, &exact.camera, [right, 0.0]);
            let object = |k: usize| {
                let ray = camera.ray((k % 256) as f64, (k / 256) as f64).unwrap();
                tracer.nearest(&ray, tracer.all()).unwrap().index
            };
            Raster::new(256, 192, (0..256 * 192).map(object).collect())
        });
        (exact.clone(), exact.render(Views::STEREO), shown)
    }

    /// The objects of a kind with the pixels that show them, and show them `reach` pixels away along rows and columns as well.
    fn pixels_of(
        random: &RandomScene,
        shown: &Raster<usize>,
        reach: usize,
        is_of_kind: impl Fn(&Object) -> bool,
    ) -> Vec<(usize, Vec<(usize, usize)>)> {
        let objects = (0..random.scene.objects.len()).filter(|k| is_of_kind(&random.scene.objects[*k]));
        let pixels = || (reach..192 - reach).flat_map(|v| (reach..256 - reach).map(move |u| (u, v)));
        let of = |index: usize| {
            let is_inside = |&(u, v): &(usize, usize)| {
                (v - reach..=v + reach).all(|y| shown.get(u, y) == index)
                    && (u - reach..=u + reach).all(|x| shown.get(x, v) == index)
            };
            (index, pixels().filter(is_inside).collect::<Vec<_>>())
        };
        objects.map(of).filter(|(_, pixels)| pixels.len() > 50).collect()
    }

    /// The mean grey difference of pixels of the centre and of what lies `step` columns to the right.
    fn change(image: &RgbImage, pixels: &[(usize, usize)], step: f64) -> f64 {
        let at = |u: f64, v: usize| gray_at(image, [u, v as f64]);
        pixels.iter().map(|&(u, v)| (at(u as f64 + step, v) - at(u as f64, v)).abs()).sum::<f64>() / pixels.len() as f64
    }

    #[test]
    fn blank_objects_have_no_gradient() {
        let plain = |object: &Object| matches!(object.texture, Texture::Plain(_)) && object.finish == Finish::Matte;
        let mut changes: Vec<f64> = (0..4)
            .flat_map(|number| {
                let (random, shot, [shown, _]) = of_kind(ObjectKind::Blank, number);
                let objects = pixels_of(&random, &shown, 4, plain);
                objects.iter().map(|(_, pixels)| change(&shot.center, pixels, 1.0)).collect::<Vec<_>>()
            })
            .collect();
        changes.sort_unstable_by(f64::total_cmp);
        // Round ones are darker on one side, and others cast shadows on them.
        assert!(changes.len() > 10 && changes[changes.len() / 2] < 0.5 && changes[changes.len() - 1] < 4.0, "{changes:.2?}");
    }

    #[test]
    fn shiny_objects_look_different_from_each_view() {
        let (mut polished, mut matte) = (0.0, 0.0);
        for number in 0..4 {
            let (random, shot, [shown, shown_right]) = of_kind(ObjectKind::Shiny, number);
            let without = random.clone().ideal().render(Views::STEREO);
            for (index, pixels) in pixels_of(&random, &shown, 3, |object| object.finish == Finish::Polished) {
                for (u, v) in pixels {
                    let there = u as f64 - f64::from(shot.truth.get(u, v));
                    let is_seen = |step: isize| {
                        let x = there.round() as isize + step;
                        (0..256).contains(&x) && shown_right.get(x as usize, v) == index
                    };
                    if is_seen(-3) && is_seen(3) {
                        let difference = |shot: &Shot| {
                            let right = gray_at(shot.frame(Frame::View(View::RIGHT)), [there, v as f64]);
                            (right - gray_at(&shot.center, [u as f64, v as f64])).abs()
                        };
                        polished += difference(&shot);
                        matte += difference(&without);
                    }
                }
            }
        }
        assert!(polished > 1.5 * matte, "{polished} grey levels in all, {matte} without reflections");
    }

    #[test]
    fn thin_objects_are_a_few_pixels_wide() {
        for number in 0..4 {
            let (_, _, [shown, _]) = of_kind(ObjectKind::Thin, number);
            // The least way across an object in four directions, which is less than 1.1 times its width, and up to a pixel more.
            let across = |u: usize, v: usize| {
                let index = shown.get(u, v);
                let way = |[x, y]: [isize; 2]| {
                    let steps = |sign: isize| {
                        let same = |k: &isize| {
                            let (u, v) = (u as isize + sign * k * x, v as isize + sign * k * y);
                            let is_inside = (0..256).contains(&u) && (0..192).contains(&v);
                            is_inside && shown.get(u as usize, v as usize) == index
                        };
                        (1..).take_while(same).count()
                    };
                    (1 + steps(1) + steps(-1)) as f64 * f64::from((x * x + y * y) as u32).sqrt()
                };
                [[1, 0], [0, 1], [1, 1], [1, -1]].map(way).into_iter().fold(f64::INFINITY, f64::min)
            };
            // No backdrop has more than three surfaces.
            let pixels = (0..192).flat_map(|v| (0..256).map(move |u| (u, v))).filter(|&(u, v)| shown.get(u, v) >= 3);
            let ways: Vec<f64> = pixels.map(|(u, v)| across(u, v)).collect();
            let widest = ways.iter().copied().fold(0.0, f64::max);
            assert!(ways.len() > 500 && widest < 1.1 * 4.4 + 2.0_f64.sqrt(), "{} pixels, up to {widest}", ways.len());
        }
    }

    #[test]
    fn repeating_objects_are_alike_at_their_distance() {
        let mut count = 0;
        for number in 0..6 {
            let (random, shot, [shown, _]) = of_kind(ObjectKind::Repeating, number);
            for (index, pixels) in pixels_of(&random, &shown, 26, |object| matches!(object.texture, Texture::Repeated { .. })) {
                let steps: Vec<f64> = (0..=80).map(|k| 4.0 + 0.25 * f64::from(k)).collect();
                let changes: Vec<f64> = steps.iter().map(|step| change(&shot.center, &pixels, *step)).collect();
                let most = changes.iter().copied().fold(0.0, f64::max);
                let (least, at) = changes.into_iter().zip(steps).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
                let Texture::Repeated { pitch, clouds: 0.0, .. } = random.scene.objects[index].texture else { continue };
                let times = (at / pitch).round();
                assert!((1.0..5.5).contains(&times) && (at - times * pitch).abs() < 0.75, "{at} pixels for {pitch}");
                assert!(least < 0.3 * most, "{least} of {most} grey levels");
                count += 1;
            }
        }
        assert!(count > 8, "{count} boards");
    }

    /// The numbers are the hashes of these bytes on every machine. They change only with the scenes.
    #[test]
    fn bytes_are_the_same_on_every_machine() {
        let expected = [(Setting::Field, 13_548_406_556_441_394_427), (Setting::Studio, 9_865_260_561_072_898_756)];
        for (setting, expected) in expected {
            let shots = (0..12).map(|number| RandomScene::within(setting, 1, number, [32, 24]).render(Views::STEREO));
            let bytes = shots.flat_map(|shot| {
                let frames = [&shot.center, &shot.neighbors[&View::RIGHT]].map(|image| image.as_raw().clone());
                let truth = shot.truth.into_pixels().into_iter().flat_map(|d| d.to_bits().to_le_bytes());
                frames.into_iter().flatten().chain(truth).collect::<Vec<_>>()
            });
            assert_eq!(bytes.fold(0, |sum, byte| hash(sum ^ u64::from(byte))), expected, "{setting:?}");
        }
    }

    /// The mean noise of 20 scenes, in grey levels.
    fn noise(setting: Setting) -> f64 {
        let mean = |number: u64| {
            let random = RandomScene::within(setting, 3, number, [64, 48]);
            let clean = RandomScene { camera: random.camera.ideal(), ..random.clone() };
            let [noisy, clean] = [random, clean].map(|random| random.render(Views::NONE).center.into_raw());
            noisy.iter().zip(&clean).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / noisy.len() as f64
        };
        (0..20).map(mean).sum::<f64>() / 20.0
    }

    #[test]
    fn a_studio_has_less_noise_than_the_field() {
        let [field, studio] = [Setting::Field, Setting::Studio].map(noise);
        assert!(studio > 0.2 && 2.0 * studio < field, "{field} grey levels in the field, {studio} in the studio");
    }
}
