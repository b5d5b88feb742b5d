//! Motifs that repeat exactly.

use super::noise::floor;

/// What repeats over `x` and `y`, at a distance of 1.
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
}
