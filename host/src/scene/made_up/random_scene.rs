//! A random scene and the rig that captures it.

use image::RgbImage;
use multiscopic_core::{Frame, Views};

use super::{
    NOMINAL_WIDTH, backdrop::backdrop, coatings::Coatings, dice::Dice, flaws::Flaws, foreground::foreground,
    illumination::illumination, viewport::Viewport,
};
use crate::{
    images::Raster,
    scene::{
        description::Scene,
        object::Finish,
        pinhole_camera::{PinholeCamera, frame_number},
        random::hash,
        render::{Quality, Tracer, develop, light_image, pixel_hash, true_disparity},
        shot::Shot,
        vec3::Vec3,
    },
};

/// A random scene, and a rig that captures it more or less well.
///
/// Everything follows from a seed and a number, with the same bytes on every machine. Disparities fill a random part of about 1 to 30
/// pixels in images that are 256 pixels wide, and of proportionally more in wider ones.
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
    /// What else is wrong with the rig.
    pub flaws: Flaws,
    /// The mean of the square root of the light in the centre frame, where white is 1.
    pub brightness: f64,
}

impl RandomScene {
    /// Scene `number` of those of a seed, for pictures of `size`. The scene does not depend on the width, only on the ratio of width and
    /// height.
    ///
    /// # Panics
    /// If the width or the height is 0.
    pub fn new(seed: u64, number: u64, size: [u32; 2]) -> RandomScene {
        assert!(size[0] > 0 && size[1] > 0, "pictures of {}x{} pixels", size[0], size[1]);
        let mut dice = Dice::new(hash(seed) ^ hash(!number));
        let viewport = random_viewport(&mut dice, size);
        let coatings = Coatings::new(&mut dice);
        let mut objects = backdrop(&mut dice, &viewport, &coatings);
        let (lamp, [sky, ground]) = illumination(&mut dice, &viewport, &objects);
        objects.extend(foreground(&mut dice, &viewport, &coatings));
        let (camera, flaws) = rig(&mut dice, &viewport, size);
        let brightness = dice.between(0.25, 0.6);
        RandomScene { scene: Scene { objects, lamp, sky, ground, viewpoint: Viewport::pose() }, camera, flaws, brightness }
    }

    /// The same scene with matte surfaces only, and a rig without noise and other flaws.
    pub fn ideal(mut self) -> RandomScene {
        self.scene.objects.iter_mut().for_each(|object| object.finish = Finish::Matte);
        RandomScene { camera: self.camera.ideal(), flaws: Flaws::NONE, ..self }
    }

    /// Renders the centre, the neighbours `views`, and the true disparities that an ideal rig would find. A frame is the same whatever the
    /// others are.
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
fn rig(dice: &mut Dice, viewport: &Viewport, [width, height]: [u32; 2]) -> (PinholeCamera, Flaws) {
    let misalignment = if dice.happens(0.35) { dice.between(0.05, 0.6) } else { 0.0 };
    let pixel = f64::from(width) / NOMINAL_WIDTH;
    let camera = PinholeCamera {
        width,
        height,
        focal_px: viewport.focal * pixel,
        baseline_mm: viewport.baseline_mm,
        // Half of what is misaligned are the positions: of the nearest things, a pixel is the baseline through their disparity.
        repeatability_mm: 0.5 * misalignment * viewport.baseline_mm / viewport.near,
        read_noise: dice.mostly_low(1.0, 8.0),
        full_well: 1.0 / dice.mostly_low(1e-5, 1.2e-3),
    };
    let flaws = Flaws {
        seed: dice.bits(),
        turned_px: misalignment * pixel,
        gain: dice.pick([0.0, 0.01, 0.03, 0.08]),
        stray: [dice.mostly_low(0.001, 0.03), dice.pick([0.0, 0.001, 0.004])],
        blur: dice.between(0.2, 0.5),
        blurs: dice.pick([1, 1, 1, 2]),
    };
    (camera, flaws)
}
