//! Value noise and fractal noise.

use crate::scene::vec3::Vec3;

/// A random number in `[0, 1)` for each point of the integer lattice.
pub fn lattice(x: i32, y: i32, z: i32) -> f64 {
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
pub fn value(p: Vec3) -> f64 {
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
