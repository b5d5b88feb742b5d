//! What a surface looks like, as colour in the space of its object.

use super::{
    noise::{floor, fractal, fractal_flat, lattice, value, value_flat},
    vector::Vec3,
};

/// A colour for every point of an object's own space, in millimetres. Colours are linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// One colour: nothing to match.
    Plain(Vec3),
    /// Two colours in clouds of every size down to `grain`.
    Clouds {
        /// The colour of the valleys.
        low: Vec3,
        /// The colour of the peaks.
        high: Vec3,
        /// The size of the finest clouds.
        grain: f64,
        /// How many sizes, each twice the one before.
        octaves: u8,
    },
    /// [`Clouds`](Texture::Clouds) on a panel.
    Plaster {
        /// The colour of the valleys.
        low: Vec3,
        /// The colour of the peaks.
        high: Vec3,
        /// The size of the finest clouds.
        grain: f64,
        /// How many sizes, each twice the one before.
        octaves: u8,
    },
    /// Growth rings around an axis near `y`, with pores along it.
    Wood {
        /// The colour of early wood.
        light: Vec3,
        /// The colour of late wood and pores.
        dark: Vec3,
        /// The distance between rings.
        ring: f64,
    },
    /// Stone with dark veins.
    Marble {
        /// The colour of the stone.
        base: Vec3,
        /// The colour of the veins.
        vein: Vec3,
        /// The typical distance between veins.
        size: f64,
    },
    /// Cubes of two colours.
    Checker {
        /// The first colour.
        even: Vec3,
        /// The second colour.
        odd: Vec3,
        /// The side of a cube.
        side: f64,
    },
    /// Chips of coloured stone in cement.
    Terrazzo {
        /// The colour of the cement.
        cement: Vec3,
        /// The colours of the chips.
        chips: [Vec3; 4],
        /// The distance between chips.
        pitch: f64,
    },
    /// Dots of different sizes and inks on a jittered grid over `x` and `y`.
    Dots {
        /// The colour of the paper.
        paper: Vec3,
        /// The colours of the dots.
        inks: [Vec3; 4],
        /// The grid's step.
        pitch: f64,
    },
    /// Woven cloth with stripes across `x`.
    Cloth {
        /// The cloth's colour.
        ground: Vec3,
        /// The stripes' colour.
        stripe: Vec3,
        /// From stripe to stripe.
        pitch: f64,
    },
    /// A metal panel brushed askew, so that its streaks can be matched along `x` and along `y`.
    Brushed(Vec3),
}

impl Texture {
    /// The colour at `p`.
    pub fn color(&self, p: Vec3) -> Vec3 {
        match *self {
            Texture::Plain(color) => color,
            Texture::Clouds { low, high, grain, octaves } => {
                low.lerp(high, contrast(fractal(p * frequency(grain, octaves), octaves, 0.75), 2.4))
            }
            Texture::Plaster { low, high, grain, octaves } => {
                let q = p * frequency(grain, octaves);
                low.lerp(high, contrast(fractal_flat(q.x, q.y, octaves, 0.75), 2.4))
            }
            Texture::Wood { light, dark, ring } => wood(p, light, dark, ring),
            Texture::Marble { base, vein, size } => marble(p, base, vein, size),
            Texture::Checker { even, odd, side } => {
                // Half a cube of offset keeps the sides of a box of whole cubes away from the change of colour.
                let q = p * (1.0 / side) + Vec3::splat(0.5);
                let color = if (floor(q.x) ^ floor(q.y) ^ floor(q.z)) & 1 == 0 { even } else { odd };
                color * (0.72 + 0.56 * fractal(p * 0.22, 3, 0.8))
            }
            Texture::Terrazzo { cement, chips, pitch } => terrazzo(p, cement, chips, pitch),
            Texture::Dots { paper, inks, pitch } => dots(p, paper, inks, pitch),
            Texture::Cloth { ground, stripe, pitch } => {
                let across = (p.x / pitch - f64::from(floor(p.x / pitch)) - 0.5).abs();
                let color = if across < 0.14 { stripe } else { ground };
                color * (0.6 + 0.8 * fractal(p * 0.2, 3, 0.9))
            }
            Texture::Brushed(color) => color * (0.1 + 1.8 * streaks(p)),
        }
    }
}

/// How bright a brush's streaks are at a point of a panel, around 0.5.
pub fn streaks(p: Vec3) -> f64 {
    let [along, across] = brush(p);
    let fine = value_flat(along / 7.0, across / 1.2, 0);
    let middle = value_flat(along / 14.0, across / 2.6, 1);
    let stain = value_flat(p.x / 4.5, p.y / 4.5, 2);
    let coarse = value_flat(along / 70.0, across / 24.0, 3);
    0.3 * fine + 0.28 * middle + 0.24 * stain + 0.18 * coarse
}

/// How far along and across the strokes of a brush a point of a panel is.
pub fn brush(p: Vec3) -> [f64; 2] {
    [0.8 * p.x + 0.6 * p.y, 0.8 * p.y - 0.6 * p.x]
}

/// The frequency of the coarsest of some octaves, of which the finest has this grain.
fn frequency(grain: f64, octaves: u8) -> f64 {
    1.0 / (grain * f64::from(1u32 << octaves.saturating_sub(1)))
}

/// `x` in `[0, 1]` with its distance from a half multiplied by `gain`.
fn contrast(x: f64, gain: f64) -> f64 {
    ((x - 0.5) * gain + 0.5).clamp(0.0, 1.0)
}

/// 0 below `from`, 1 above `to`, and a smooth rise between.
fn rise(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn wood(p: Vec3, light: Vec3, dark: Vec3, ring: f64) -> Vec3 {
    let bend = fractal(Vec3::new(p.x, p.y * 0.25, p.z) * (0.35 / ring), 2, 0.5);
    // The pith is outside the piece, and the piece was cut a little askew.
    let (x, z) = (p.x + 5.3 * ring + 0.12 * p.y, p.z + 3.1 * ring);
    let age = (x * x + z * z).sqrt() / ring + 2.2 * bend;
    let season = age - f64::from(floor(age));
    let late = rise(0.25, 0.9, season) * (1.0 - rise(0.94, 1.0, season));
    let pores = value(Vec3::new(p.x * 0.9, p.y * 0.09, p.z * 0.9));
    let fibre = fractal(Vec3::new(p.x * 0.3, p.y * 0.04, p.z * 0.3), 3, 0.8);
    light.lerp(dark, (0.75 * late + 0.5 * rise(0.66, 0.9, pores)).min(1.0)) * (0.65 + 0.7 * fibre)
}

fn marble(p: Vec3, base: Vec3, vein: Vec3, size: f64) -> Vec3 {
    let q = p * (1.0 / size);
    let warp = Vec3::new(
        fractal(q + Vec3::splat(3.7), 3, 0.5),
        fractal(q + Vec3::splat(11.9), 3, 0.5),
        fractal(q + Vec3::splat(27.1), 3, 0.5),
    );
    let field = fractal(q * 0.8 + warp * 1.6, 4, 0.5);
    let broad = 1.0 - rise(0.0, 0.07, (field - 0.5).abs());
    let thin = 1.0 - rise(0.0, 0.03, (value(q * 2.3 + warp * 2.0) - 0.5).abs());
    let clouds = fractal(p * 0.06, 5, 0.85);
    (base * (0.62 + 0.66 * clouds)).lerp(vein, (0.75 * broad + 0.45 * thin).min(0.9))
}

/// The nearest of the randomly placed chips or dots around `p`, as its distance in cells relative to its random radius, and
/// a random number of its own; `None` between them.
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

fn pick(colors: [Vec3; 4], random: f64) -> Vec3 {
    colors[(random * 4.0) as usize & 3]
}

fn terrazzo(p: Vec3, cement: Vec3, chips: [Vec3; 4], pitch: f64) -> Vec3 {
    let grain = fractal(p * 0.15, 4, 0.9);
    // A bent space makes the round chips angular.
    let bend = Vec3::new(value(p * (2.1 / pitch)), value(p * (2.3 / pitch)), value(p * (1.9 / pitch)));
    match nearest_seed(p * (1.0 / pitch) + bend * 0.7, true, |random| 0.22 + 0.4 * random * random) {
        Some((_, random)) => pick(chips, random) * (0.8 + 0.4 * grain),
        None => cement * (0.7 + 0.6 * grain),
    }
}

fn dots(p: Vec3, paper: Vec3, inks: [Vec3; 4], pitch: f64) -> Vec3 {
    let grain = 0.82 + 0.36 * fractal_flat(p.x * 0.12, p.y * 0.12, 3, 0.9);
    let q = Vec3::new(p.x / pitch, p.y / pitch, 0.0);
    let color = match nearest_seed(q, false, |random| 0.18 + 0.34 * random) {
        Some((_, random)) => pick(inks, random),
        None => paper,
    };
    color * grain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_physical() {
        let [a, b] = [Vec3::srgb(0xF0E0D0), Vec3::srgb(0x204060)];
        let textures = [
            Texture::Plain(a),
            Texture::Clouds { low: a, high: b, grain: 2.0, octaves: 5 },
            Texture::Plaster { low: a, high: b, grain: 2.0, octaves: 5 },
            Texture::Wood { light: a, dark: b, ring: 8.0 },
            Texture::Marble { base: a, vein: b, size: 60.0 },
            Texture::Checker { even: a, odd: b, side: 10.0 },
            Texture::Terrazzo { cement: a, chips: [a, b, a, b], pitch: 12.0 },
            Texture::Dots { paper: a, inks: [b; 4], pitch: 12.0 },
            Texture::Cloth { ground: a, stripe: b, pitch: 20.0 },
            Texture::Brushed(a),
        ];
        for texture in textures {
            for i in 0..500 {
                let p = Vec3::new(f64::from(i) * 0.7 - 170.0, f64::from(i % 37) * 3.1 - 50.0, f64::from(i % 11) * 5.3 - 29.0);
                let color = texture.color(p);
                for channel in [color.x, color.y, color.z] {
                    assert!((0.0..1.8).contains(&channel), "{texture:?} at {p:?}: {channel}");
                }
            }
        }
    }
}
