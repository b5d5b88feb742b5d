//! The patterns of textures that take more than a line, and the noise in them: value noise and fractal noise.

use crate::scene::geometry::{Pose, Vec3};

/// The brightness of brushed metal at a point of a panel, around 0.5.
pub(crate) fn streaks(p: Vec3) -> f64 {
    let [along, across] = along_and_across_strokes(p);
    let fine = value_flat(along / 7.0, across / 1.2, 0);
    let middle = value_flat(along / 14.0, across / 2.6, 1);
    let stain = value_flat(p.x / 4.5, p.y / 4.5, 2);
    let coarse = value_flat(along / 70.0, across / 24.0, 3);
    0.3 * fine + 0.28 * middle + 0.24 * stain + 0.18 * coarse
}

/// The coordinates of a point of a panel along and across its brush strokes.
pub(crate) fn along_and_across_strokes(p: Vec3) -> [f64; 2] {
    [0.8 * p.x + 0.6 * p.y, 0.8 * p.y - 0.6 * p.x]
}

/// 0 below `from`, 1 above `to`, and a smooth step between them.
fn smooth_step(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Wood with growth rings `ring` apart.
pub(crate) fn wood(p: Vec3, light: Vec3, dark: Vec3, ring: f64) -> Vec3 {
    let bend = fractal(Vec3::new(p.x, p.y * 0.25, p.z) * (0.35 / ring), 2, 0.5);
    // The axis of the rings lies outside the object and leans a little.
    let (x, z) = (p.x + 5.3 * ring + 0.12 * p.y, p.z + 3.1 * ring);
    let age = (x * x + z * z).sqrt() / ring + 2.2 * bend;
    let season = age - f64::from(floor(age));
    let late = smooth_step(0.25, 0.9, season) * (1.0 - smooth_step(0.94, 1.0, season));
    let pores = value(Vec3::new(p.x * 0.9, p.y * 0.09, p.z * 0.9));
    let fibre = fractal(Vec3::new(p.x * 0.3, p.y * 0.04, p.z * 0.3), 3, 0.8);
    light.lerp(dark, (0.75 * late + 0.5 * smooth_step(0.66, 0.9, pores)).min(1.0)) * (0.65 + 0.7 * fibre)
}

/// Marble with veins about `size` apart.
pub(crate) fn marble(p: Vec3, base: Vec3, vein: Vec3, size: f64) -> Vec3 {
    let q = p * (1.0 / size);
    let warp = Vec3::new(
        fractal(q + Vec3::splat(3.7), 3, 0.5),
        fractal(q + Vec3::splat(11.9), 3, 0.5),
        fractal(q + Vec3::splat(27.1), 3, 0.5),
    );
    let field = fractal(q * 0.8 + warp * 1.6, 4, 0.5);
    let broad = 1.0 - smooth_step(0.0, 0.07, (field - 0.5).abs());
    let thin = 1.0 - smooth_step(0.0, 0.03, (value(q * 2.3 + warp * 2.0) - 0.5).abs());
    let clouds = fractal(p * 0.06, 5, 0.85);
    (base * (0.62 + 0.66 * clouds)).lerp(vein, (0.75 * broad + 0.45 * thin).min(0.9))
}

/// The nearest of the randomly placed seeds around `p`: its distance relative to its random radius, and a
/// random number of its own. `None` if `p` is outside all radii. Seeds have three dimensions if `deep`,
/// otherwise two.
fn nearest_seed(p: Vec3, deep: bool, radius: impl Fn(f64) -> f64) -> Option<(f64, f64)> {
    let cell = [floor(p.x), floor(p.y), floor(p.z)];
    let mut nearest: Option<(f64, f64)> = None;
    for dz in if deep { -1..=1 } else { 0..=0 } {
        for dy in -1..=1 {
            for dx in -1..=1 {
                let (x, y, z) = (cell[0] + dx, cell[1] + dy, cell[2] + dz);
                let random = |salt: i32| lattice(x, y, z.wrapping_mul(8).wrapping_add(salt));
                let jitter = Vec3::new(random(0), random(1), if deep { random(2) } else { p.z - f64::from(cell[2]) });
                let seed = Vec3::new(f64::from(x), f64::from(y), f64::from(z)) + jitter;
                let relative = (p - seed).length() / radius(random(3));
                if relative < nearest.map_or(1.0, |(least, _)| least) {
                    nearest = Some((relative, random(4)));
                }
            }
        }
    }
    nearest
}

fn choose(colors: [Vec3; 4], random: f64) -> Vec3 {
    colors[(random * 4.0) as usize & 3]
}

/// Terrazzo with chips about `pitch` apart.
pub(crate) fn terrazzo(p: Vec3, cement: Vec3, chips: [Vec3; 4], pitch: f64) -> Vec3 {
    let grain = fractal(p * 0.15, 4, 0.9);
    // Warping the coordinates turns round chips into angular ones.
    let bend = Vec3::new(value(p * (2.1 / pitch)), value(p * (2.3 / pitch)), value(p * (1.9 / pitch)));
    match nearest_seed(p * (1.0 / pitch) + bend * 0.7, true, |random| 0.22 + 0.4 * random * random) {
        Some((_, random)) => choose(chips, random) * (0.8 + 0.4 * grain),
        None => cement * (0.7 + 0.6 * grain),
    }
}

/// Dots on a grid with spacing `pitch`.
pub(crate) fn dots(p: Vec3, paper: Vec3, inks: [Vec3; 4], pitch: f64) -> Vec3 {
    let grain = 0.82 + 0.36 * fractal_flat(p.x * 0.12, p.y * 0.12, 3, 0.9);
    let q = Vec3::new(p.x / pitch, p.y / pitch, 0.0);
    let color = match nearest_seed(q, false, |random| 0.18 + 0.34 * random) {
        Some((_, random)) => choose(inks, random),
        None => paper,
    };
    color * grain
}

/// A motif that repeats over `x` and `y`, at a distance of 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motif {
    /// Stripes with sharp edges along `y`.
    Stripes,
    /// Stripes along `y` that fade into each other.
    Waves,
    /// A checkerboard, whose squares have half the distance as their sides.
    Checks,
    /// Bricks, each row moved by half a brick.
    Bricks,
    /// Discs on a square grid.
    Discs,
}

impl Motif {
    /// All motifs.
    pub const ALL: [Motif; 5] = [Motif::Stripes, Motif::Waves, Motif::Checks, Motif::Bricks, Motif::Discs];

    /// The share of the second colour at a point.
    pub(super) fn share(self, x: f64, y: f64) -> f64 {
        let fraction = |x: f64| x - f64::from(floor(x));
        let is_second = match self {
            Motif::Stripes => fraction(x) < 0.4,
            Motif::Waves => {
                let wave = (2.0 * fraction(x) - 1.0).abs();
                return wave * wave * (3.0 - 2.0 * wave);
            }
            Motif::Checks => (fraction(x) < 0.5) != (fraction(y) < 0.5),
            Motif::Bricks => {
                let row = floor(2.0 * y);
                let along = fraction(x + 0.5 * f64::from(row & 1));
                along < 0.08 || fraction(2.0 * y) < 0.16
            }
            Motif::Discs => {
                let [x, y] = [x, y].map(|x| fraction(x) - 0.5);
                x * x + y * y < 0.1
            }
        };
        f64::from(u8::from(is_second))
    }
}

/// The place of a texture in the coordinates of an object, and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The origin and the axes of the texture.
    pub pose: Pose,
    /// The factor by which it is larger than by itself.
    pub scale: f64,
}

impl Placement {
    /// The texture as it is: its coordinates are those of the object.
    pub const IDENTITY: Placement = Placement { pose: Pose::at(Vec3::ZERO), scale: 1.0 };

    /// The point of the texture that lies at a point of the object.
    pub(crate) fn texture_point(&self, local: Vec3) -> Vec3 {
        self.pose.local_point(local) * (1.0 / self.scale)
    }
}

/// A random number in `[0, 1)` for each point of the integer lattice.
fn lattice(x: i32, y: i32, z: i32) -> f64 {
    mix_lattice(lattice_part(x, 0), lattice_part(y, 1), lattice_part(z, 2))
}

/// The contribution of one coordinate to the hash of a lattice point.
fn lattice_part(coordinate: i32, axis: usize) -> u32 {
    const FACTORS: [u32; 3] = [0x9E37_79B1, 0x85EB_CA77, 0xC2B2_AE3D];
    (coordinate as u32).wrapping_mul(FACTORS[axis]).rotate_left(10 * axis as u32)
}

fn mix_lattice(x: u32, y: u32, z: u32) -> f64 {
    let mut h = x ^ y ^ z;
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    f64::from(h ^ (h >> 16)) / 4_294_967_296.0
}

/// The largest integer not above `x`. `f64::floor` would be a function call on processors without an
/// instruction for it.
pub fn floor(x: f64) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from(f64::from(towards_zero) > x)
}

/// Value noise in `[0, 1)`: smooth interpolation between the random numbers of the lattice points.
fn value(p: Vec3) -> f64 {
    let cell = [floor(p.x), floor(p.y), floor(p.z)];
    let part = |axis: usize| [lattice_part(cell[axis], axis), lattice_part(cell[axis].wrapping_add(1), axis)];
    let (x, y, z) = (part(0), part(1), part(2));
    let f = (p - Vec3::new(f64::from(cell[0]), f64::from(cell[1]), f64::from(cell[2]))).map(|t| t * t * (3.0 - 2.0 * t));
    let mix = |a: f64, b: f64, share: f64| a + (b - a) * share;
    let row = |y: u32, z: u32| mix(mix_lattice(x[0], y, z), mix_lattice(x[1], y, z), f.x);
    let layer = |z: u32| mix(row(y[0], z), row(y[1], z), f.y);
    mix(layer(z[0]), layer(z[1]), f.z)
}

/// Two-dimensional [`value`] noise, at half the cost. Each `plane` has noise of its own.
pub fn value_flat(x: f64, y: f64, plane: i32) -> f64 {
    let cell = [floor(x), floor(y)];
    let plane = lattice_part(plane, 2);
    let f = [x - f64::from(cell[0]), y - f64::from(cell[1])].map(|t| t * t * (3.0 - 2.0 * t));
    let row = |y: i32| {
        let y = lattice_part(y, 1);
        let at = |x: i32| mix_lattice(lattice_part(x, 0), y, plane);
        let (a, b) = (at(cell[0]), at(cell[0].wrapping_add(1)));
        a + (b - a) * f[0]
    };
    let (a, b) = (row(cell[1]), row(cell[1].wrapping_add(1)));
    a + (b - a) * f[1]
}

/// Fractal noise in `[0, 1)`: a sum of `octaves` of value noise. Each octave has twice the frequency of the
/// one before, and `gain` times its amplitude.
pub fn fractal(mut p: Vec3, octaves: u8, gain: f64) -> f64 {
    let (mut sum, mut total, mut strength) = (0.0, 0.0, 1.0);
    for _ in 0..octaves {
        sum += strength * value(p);
        total += strength;
        strength *= gain;
        // The offset keeps the lattices of different octaves from coinciding at the origin.
        p = p * 2.0 + Vec3::new(17.3, 41.7, 29.1);
    }
    sum / total
}

/// Two-dimensional [`fractal`] noise.
pub fn fractal_flat(mut x: f64, y: f64, octaves: u8, gain: f64) -> f64 {
    let (mut y, mut sum, mut total, mut strength) = (y, 0.0, 0.0, 1.0);
    for octave in 0..octaves {
        sum += strength * value_flat(x, y, i32::from(octave));
        total += strength;
        strength *= gain;
        (x, y) = (2.0 * x + 17.3, 2.0 * y + 41.7);
    }
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motifs_repeat_and_have_both_colours() {
        for motif in Motif::ALL {
            let mut mean = 0.0;
            for k in 0..400 {
                let (x, y) = (f64::from(k % 20) * 0.05 + 0.01, f64::from(k / 20) * 0.05 + 0.01);
                let share = motif.share(x, y);
                assert!((0.0..=1.0).contains(&share));
                assert!((motif.share(x - 3.0, y + 5.0) - share).abs() < 1e-9, "{motif:?} at {x}, {y}");
                mean += share / 400.0;
            }
            assert!((0.1..0.9).contains(&mean), "{motif:?}: {mean}");
        }
    }

    #[test]
    fn value_noise_is_continuous_and_fills_its_range() {
        let line = |i: i32| value(Vec3::new(f64::from(i) * 0.01, 3.0, -2.0));
        let (mut least, mut greatest) = (1.0f64, 0.0f64);
        for i in -5000..5000 {
            least = least.min(line(i));
            greatest = greatest.max(line(i));
            assert!((line(i + 1) - line(i)).abs() < 0.02);
        }
        assert!(least < 0.2 && greatest > 0.8 && least >= 0.0 && greatest < 1.0);
    }
}
