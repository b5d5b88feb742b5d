//! Procedural textures: the colour of a surface at each point.

pub mod patterns;

use super::geometry::Vec3;

use patterns::{floor, fractal, fractal_flat};

pub use self::patterns::{Motif, Placement};

/// A colour for every point of an object. Points are in the object's own coordinates, in millimetres; colours
/// are linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// A single colour, which gives matching nothing to hold on to.
    Plain(Vec3),
    /// Fractal clouds of two colours, with details down to the size `grain`.
    Clouds {
        /// The colour where the noise is low.
        low: Vec3,
        /// The colour where the noise is high.
        high: Vec3,
        /// The size of the finest clouds.
        grain: f64,
        /// The number of octaves, each with clouds half the size of the one before.
        octaves: u8,
    },
    /// Two-dimensional [`Clouds`](Texture::Clouds), for panels.
    Plaster {
        /// The colour where the noise is low.
        low: Vec3,
        /// The colour where the noise is high.
        high: Vec3,
        /// The size of the finest clouds.
        grain: f64,
        /// The number of octaves, each with clouds half the size of the one before.
        octaves: u8,
    },
    /// Wood with growth rings around an axis close to `y`, and pores along it.
    Wood {
        /// The colour of earlywood.
        light: Vec3,
        /// The colour of latewood and pores.
        dark: Vec3,
        /// The distance between growth rings.
        ring: f64,
    },
    /// Marble with veins.
    Marble {
        /// The colour of the stone.
        base: Vec3,
        /// The colour of the veins.
        vein: Vec3,
        /// The typical distance between veins.
        size: f64,
    },
    /// A three-dimensional checkerboard.
    Checker {
        /// The colour of even cells.
        even: Vec3,
        /// The colour of odd cells.
        odd: Vec3,
        /// The side of a cell.
        side: f64,
    },
    /// Terrazzo: chips of coloured stone in cement.
    Terrazzo {
        /// The colour of the cement.
        cement: Vec3,
        /// The colours of the chips.
        chips: [Vec3; 4],
        /// The distance between chips.
        pitch: f64,
    },
    /// Dots of random sizes and colours on a jittered grid over `x` and `y`.
    Dots {
        /// The colour of the paper.
        paper: Vec3,
        /// The colours of the dots.
        inks: [Vec3; 4],
        /// The spacing of the grid.
        pitch: f64,
    },
    /// Cloth with stripes across `x`.
    Cloth {
        /// The colour of the cloth.
        ground: Vec3,
        /// The colour of the stripes.
        stripe: Vec3,
        /// The distance between stripes.
        pitch: f64,
    },
    /// Metal brushed at an angle, so that its streaks can be matched along both `x` and `y`.
    Brushed(Vec3),
    /// A motif of two colours that repeats exactly over `x` and `y`, under clouds that may tell its repetitions apart.
    Repeated {
        /// The motif that repeats.
        motif: Motif,
        /// Its two colours.
        colors: [Vec3; 2],
        /// The distance at which it repeats.
        pitch: f64,
        /// The change of its brightness by the clouds, from 0 for none to 1.
        clouds: f64,
    },
    /// Areas of four plain colours with curved outlines, as in a poster.
    Poster {
        /// The colours.
        inks: [Vec3; 4],
        /// The size of the areas.
        size: f64,
    },
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
            Texture::Wood { light, dark, ring } => patterns::wood(p, light, dark, ring),
            Texture::Marble { base, vein, size } => patterns::marble(p, base, vein, size),
            Texture::Checker { even, odd, side } => {
                // Offset by half a cell, so that the faces of a box of whole cells do not lie on a colour
                // change.
                let q = p * (1.0 / side) + Vec3::splat(0.5);
                let color = if (floor(q.x) ^ floor(q.y) ^ floor(q.z)) & 1 == 0 { even } else { odd };
                color * (0.72 + 0.56 * fractal(p * 0.22, 3, 0.8))
            }
            Texture::Terrazzo { cement, chips, pitch } => patterns::terrazzo(p, cement, chips, pitch),
            Texture::Dots { paper, inks, pitch } => patterns::dots(p, paper, inks, pitch),
            Texture::Cloth { ground, stripe, pitch } => {
                let across = (p.x / pitch - f64::from(floor(p.x / pitch)) - 0.5).abs();
                let color = if across < 0.14 { stripe } else { ground };
                color * (0.6 + 0.8 * fractal(p * 0.2, 3, 0.9))
            }
            Texture::Brushed(color) => color * (0.1 + 1.8 * patterns::streaks(p)),
            Texture::Repeated { motif, colors: [first, second], pitch, clouds } => {
                let color = first.lerp(second, motif.share(p.x / pitch, p.y / pitch));
                match clouds > 0.0 {
                    true => color * (1.0 + clouds * (fractal_flat(p.x * 0.3, p.y * 0.3, 3, 0.9) - 0.5)),
                    false => color,
                }
            }
            Texture::Poster { inks, size } => {
                let level = 4.0 * contrast(fractal(p * (1.0 / size), 3, 0.5), 2.0);
                inks[(level as usize).min(3)]
            }
        }
    }
}

/// The frequency of the coarsest octave if the finest has details of the size `grain`.
fn frequency(grain: f64, octaves: u8) -> f64 {
    1.0 / (grain * f64::from(1u32 << octaves.saturating_sub(1)))
}

/// Multiplies the distance of `x` from 0.5 by `gain`, and clamps to `[0, 1]`.
fn contrast(x: f64, gain: f64) -> f64 {
    ((x - 0.5) * gain + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_in_range() {
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
            Texture::Repeated { motif: Motif::Bricks, colors: [a, b], pitch: 9.0, clouds: 0.6 },
            Texture::Poster { inks: [a, b, b, a], size: 20.0 },
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
