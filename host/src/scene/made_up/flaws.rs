//! What is wrong with a camera and its stage.

use multiscopic_core::Frame;

use super::dice::Dice;
use crate::{
    images::Raster,
    scene::{
        pinhole_camera::{PinholeCamera, frame_number},
        pose::Pose,
        posed_camera::PosedCamera,
        random::hash,
        vec3::Vec3,
    },
};

/// How the frames of a capture differ from those of an ideal rig, besides the noise of [`PinholeCamera`] and its misses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flaws {
    /// Decides what differs from frame to frame.
    pub seed: u64,
    /// The most by which a view is turned up, down, left or right, in pixels, and at the left and right edge about the optical axis.
    pub turned_px: f64,
    /// The most by which the brightness of a view differs, as a share of it.
    pub gain: f64,
    /// The stray light on every pixel, of which white is 1, and the most by which it differs between frames.
    pub stray: [f64; 2],
    /// The share of its light that a pixel gives to its neighbours in the row, and then to those in the column, each time.
    pub blur: f64,
    /// How often it does.
    pub blurs: u32,
}

impl Flaws {
    /// Nothing is wrong.
    pub const NONE: Flaws = Flaws { seed: 0, turned_px: 0.0, gain: 0.0, stray: [0.0; 2], blur: 0.0, blurs: 0 };

    /// The camera of a frame. The centre stands where it should.
    pub(super) fn camera(&self, viewpoint: &Pose, sensor: &PinholeCamera, frame: Frame) -> PosedCamera {
        let camera = PosedCamera::beside(viewpoint, sensor, sensor.position(frame, self.seed));
        let Frame::View(_) = frame else { return camera };
        let mut dice = self.dice(frame);
        let mut turn = |px: f64| dice.between(-px, px) / 2.0;
        // At small angles, the tangent of half the angle is half the angle.
        let [up, aside] = [0; 2].map(|_| turn(self.turned_px) / sensor.focal_px);
        let roll = turn(self.turned_px) / (f64::from(sensor.width) / 2.0);
        PosedCamera { pose: camera.pose.turned(0, up).turned(1, aside).turned(2, roll), ..camera }
    }

    /// The light on the sensor of a frame, made of what would fall on it through an ideal lens, at an exposure.
    pub(super) fn expose(&self, light: &mut Raster<Vec3>, frame: Frame, exposure: f64) {
        for _ in 0..self.blurs {
            blur(light, self.blur);
        }
        let mut dice = self.dice(frame);
        // Those of the pose were drawn before.
        (0..3).for_each(|_| _ = dice.bits());
        let gain = exposure * (1.0 + dice.between(-self.gain, self.gain));
        let stray = self.stray[0] + dice.between(0.0, self.stray[1]);
        light.pixels_mut().iter_mut().for_each(|light| *light = *light * gain + Vec3::splat(stray));
    }

    fn dice(&self, frame: Frame) -> Dice {
        Dice::new(hash(self.seed) ^ frame_number(frame))
    }
}

/// Gives a share of the light of each pixel to its neighbours. At the borders it stays.
fn blur(light: &mut Raster<Vec3>, share: f64) {
    let [width, height] = [light.width(), light.height()];
    let mix = |before: Vec3, here: Vec3, after: Vec3| here * (1.0 - share) + (before + after) * (0.5 * share);
    for row in light.rows_mut() {
        let mut before = row[0];
        for u in 0..width {
            let here = row[u];
            row[u] = mix(before, here, row[(u + 1).min(width - 1)]);
            before = here;
        }
    }
    let mut before = light.row(0).to_vec();
    for v in 0..height {
        let here = light.row(v).to_vec();
        let after = if v + 1 < height { light.row(v + 1).to_vec() } else { here.clone() };
        for (u, pixel) in light.row_mut(v).iter_mut().enumerate() {
            *pixel = mix(before[u], here[u], after[u]);
        }
        before = here;
    }
}
