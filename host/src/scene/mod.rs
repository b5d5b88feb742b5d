//! Synthetic scenes with known depth: a small ray tracer, with a camera on a stage that takes the frames.
//!
//! Every machine renders the same bytes. The code uses only operations that IEEE 754 rounds exactly
//! (`+ - * /` and square root, but no powers, logarithms or angles), every random number is a hash of its
//! place and the seed, and no sum depends on the order of threads.
//!
//! ```
//! use multiscopic::scene::{PinholeCamera, Scene, render};
//! let camera = PinholeCamera::new(64, 48);
//! let shot = render(&Scene::demo(), &camera, 1);
//! assert_eq!(shot.center.dimensions(), (64, 48));
//! assert!(shot.truth.pixels().iter().all(|d| (0.5..5.5).contains(d)));
//! ```

mod description;
mod geometry;
mod made_up;
mod pinhole_camera;
mod render;
mod texture;

pub use description::{Finish, Lamp, Object, Scene, Shot};
pub use geometry::{Pose, Ray, Shape, Vec3};
pub use made_up::{Flaws, ObjectKind, RandomScene, Setting};
pub use pinhole_camera::{PinholeCamera, PosedCamera};
pub use render::{render, render_at, render_moving, render_sweep, render_views, trace};
pub use texture::{Motif, Placement, Texture};

// Reproducible random numbers: hashes of a place and a seed, and evenly distributed sample points.

/// The output function of SplitMix64: well-mixed bits from any counter.
fn hash(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// A number in `[0, 1)` from the upper bits of a hash.
fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// A roughly normal number with mean 0 and variance 1. It is the sum of four uniform numbers, so it never
/// exceeds 3.5.
fn gaussian(hash: u64) -> f64 {
    let sum: u64 = (0..4).map(|i| (hash >> (16 * i)) & 0xFFFF).sum();
    (sum as f64 / 65535.0 - 2.0) * 3f64.sqrt()
}

/// Point `index` of a (0,2)-sequence in the unit square. The first 2^n points are evenly distributed for
/// every n.
fn even_square(index: u32) -> [f64; 2] {
    let mut sobol = 0;
    let (mut rest, mut column) = (index, 1u32 << 31);
    while rest != 0 {
        if rest & 1 == 1 {
            sobol ^= column;
        }
        rest >>= 1;
        column ^= column >> 1;
    }
    [index.reverse_bits(), sobol].map(|bits| (f64::from(bits) + 0.5) / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_has_unit_variance() {
        let samples = || (0..20_000).map(|i| gaussian(hash(i)));
        let n = samples().count() as f64;
        let mean = samples().sum::<f64>() / n;
        let variance = samples().map(|x| x * x).sum::<f64>() / n;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
    }

    #[test]
    fn the_first_sixteen_points_hit_sixteen_cells() {
        let mut cells = [0; 16];
        for i in 0..16 {
            let [x, y] = even_square(i);
            cells[(x * 4.0) as usize * 4 + (y * 4.0) as usize] += 1;
        }
        assert_eq!(cells, [1; 16]);
    }
}
