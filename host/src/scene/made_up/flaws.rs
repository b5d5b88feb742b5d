//! Flaws of a camera and its stage.

use multiscopic_core::Frame;

use crate::{
    images::Raster,
    scene::{
        geometry::{Pose, Vec3},
        hash,
        pinhole_camera::{PinholeCamera, PosedCamera, frame_number},
        unit,
    },
};

/// The differences of a capture's frames from those of an ideal rig, besides the noise of [`PinholeCamera`] and its misses.
///
/// The imperfections of simulated hardware are others: they describe a stage and a lens, and take angles, whose sines are not
/// the same on every machine to the last bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flaws {
    /// Decides what differs from frame to frame.
    pub seed: u64,
    /// The most by which a view is turned up, down, left or right, in pixels, and at the left and right edge about the optical
    /// axis.
    pub(crate) turned_px: f64,
    /// The most by which the brightness of a view differs, as a share of it.
    pub gain: f64,
    /// The stray light on every pixel, of which white is 1, and the most by which it differs between frames.
    pub(crate) stray: [f64; 2],
    /// The share of its light that a pixel gives to its neighbours in the row, and then to those in the column, each time.
    pub(crate) blur: f64,
    /// The number of times that it does.
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

/// Random numbers in the order in which they are drawn, the same on every machine.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(hash(seed))
    }

    /// Bits from which other sequences may start.
    pub fn bits(&mut self) -> u64 {
        self.0 = hash(self.0);
        self.0
    }

    /// A number from `low` to `high`, all equally likely.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(self.bits())
    }

    /// A number from `low` to `high`, of which half are in the first quarter.
    pub(crate) fn mostly_low(&mut self, low: f64, high: f64) -> f64 {
        let share = unit(self.bits());
        low + (high - low) * share * share
    }

    /// A number from `-most` to `most`, of which half are less than a quarter of it.
    pub(crate) fn around_zero(&mut self, most: f64) -> f64 {
        let share = self.between(-1.0, 1.0);
        most * share * share.abs()
    }

    /// Decides by chance if something of this probability happens.
    pub(crate) fn happens(&mut self, probability: f64) -> bool {
        unit(self.bits()) < probability
    }

    /// A whole number from `low` to `high`, both included.
    pub fn count(&mut self, low: u32, high: u32) -> u32 {
        low + (self.bits() % u64::from(high - low + 1)) as u32
    }

    /// One of several things.
    pub(crate) fn pick<T: Copy, const N: usize>(&mut self, choices: [T; N]) -> T {
        choices[(self.bits() % N as u64) as usize]
    }

    /// The pose turned about its own axes, each half turn in either direction being possible.
    pub fn turned(&mut self, pose: Pose) -> Pose {
        (0..3).fold(pose, |pose, axis| pose.turned(axis, self.between(-1.0, 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::View;

    use super::*;

    const RIGHT: Frame = Frame::View(View::RIGHT);

    #[test]
    fn blur_spreads_the_light_of_a_pixel() {
        let flaws = Flaws { blur: 0.4, blurs: 1, ..Flaws::NONE };
        let mut light = Raster::filled(6, 5, Vec3::ZERO);
        light.row_mut(2)[3] = Vec3::splat(100.0);
        flaws.expose(&mut light, RIGHT, 1.0);
        let weight = |distance: usize| [0.6, 0.2, 0.0][distance.min(2)];
        for (u, v) in (0..5).flat_map(|v| (0..6).map(move |u: usize| (u, v))) {
            let expected = 100.0 * weight(u.abs_diff(3)) * weight(2_usize.abs_diff(v));
            assert!((light.get(u, v).x - expected).abs() < 1e-9, "({u}, {v})");
        }
        // At the borders no light is lost.
        let mut even = Raster::filled(4, 3, Vec3::splat(2.0));
        Flaws { blurs: 2, ..flaws }.expose(&mut even, RIGHT, 1.0);
        assert!(even.pixels().iter().all(|light| (*light - Vec3::splat(2.0)).length() < 1e-12));
    }

    #[test]
    fn frames_differ_in_brightness_and_direction_by_what_was_asked_for() {
        let sensor = PinholeCamera::new(200, 150).ideal();
        let (mut brightest, mut farthest) = (0.0_f64, 0.0_f64);
        for seed in 0..60 {
            let flaws = Flaws { seed, turned_px: 0.5, gain: 0.1, stray: [0.01, 0.0], ..Flaws::NONE };
            let mut light = Raster::filled(1, 1, Vec3::splat(0.5));
            flaws.expose(&mut light, RIGHT, 2.0);
            brightest = brightest.max((light.get(0, 0).y - 0.01 - 1.0).abs());
            let level = Pose::at(Vec3::ZERO);
            let pose = flaws.camera(&level, &sensor, RIGHT).pose;
            // Where the optical axis of the level camera appears: by how much the view is turned.
            let ahead = pose.local_direction(Vec3::Z) * sensor.focal_px;
            farthest = [ahead.x, ahead.y, 100.0 * pose.axes[0].y].into_iter().fold(farthest, |most, px| most.max(px.abs()));
            assert_eq!(flaws.camera(&level, &sensor, Frame::Center).pose, level);
        }
        assert!((0.09..=0.1).contains(&brightest), "{brightest}");
        assert!((0.45..=0.51).contains(&farthest), "{farthest} pixels");
        let [once, twice] = [3, 3].map(|seed| Flaws { seed, turned_px: 1.0, ..Flaws::NONE });
        let pose = |flaws: Flaws, view| flaws.camera(&Pose::at(Vec3::ZERO), &sensor, Frame::View(view)).pose;
        assert_eq!(pose(once, View::TOP), pose(twice, View::TOP));
        assert_ne!(pose(once, View::TOP).axes, pose(once, View::LEFT).axes);
    }
}
