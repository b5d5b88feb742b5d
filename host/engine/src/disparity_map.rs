//! The result of matching: a disparity for every pixel of the centre frame.

use std::ops::RangeInclusive;

use multiscopic_core::Disparity;

use crate::raster::{FloatImage, Raster};

/// The disparity of every pixel; `None` marks an invalid one.
///
/// ```
/// use multiscopic_engine::{DisparityMap, FloatImage};
/// let map = DisparityMap::from_float(&FloatImage::new(3, 1, vec![1.5, f32::INFINITY, 60.0]));
/// assert_eq!(map.get(1, 0), None);
/// assert_eq!(map.range(), Some(1.5..=60.0));
/// assert_eq!(map.to_float().pixels(), [1.5, f32::INFINITY, 60.0]);
/// ```
pub type DisparityMap = Raster<Option<Disparity>>;

impl DisparityMap {
    /// The disparities in pixels, +inf where invalid.
    pub fn to_float(&self) -> FloatImage {
        self.map(|pixel| pixel.map_or(f32::INFINITY, f32::from))
    }

    /// Rounds disparities in pixels to the nearest step. A pixel that is not finite or does not fit a
    /// [`Disparity`] is invalid.
    pub fn from_float(pixels: &FloatImage) -> DisparityMap {
        let limits = f32::from(-i16::MAX)..=f32::from(i16::MAX);
        pixels.map(|d| {
            let steps = (d * Disparity::STEPS as f32).round();
            limits.contains(&steps).then(|| Disparity::from_bits(steps as i16)).flatten()
        })
    }

    /// The disparities at a baseline `factor` times as long. Those beyond the range of a [`Disparity`] become its ends.
    pub fn times(&self, factor: u8) -> DisparityMap {
        let limit = i32::from(i16::MAX);
        let times = |d: Disparity| (i32::from(d.to_bits()) * i32::from(factor)).clamp(-limit, limit);
        self.map(|pixel| pixel.and_then(|d| Disparity::from_bits(times(d) as i16)))
    }

    /// The shares of the valid pixels whose disparity is the first and the last of a range, to the nearest pixel.
    pub fn shares_at_ends(&self, range: RangeInclusive<i16>) -> [f64; 2] {
        let valid: Vec<f32> = self.pixels().iter().flatten().map(|&d| f32::from(d).round()).collect();
        let share = |end: i16| valid.iter().filter(|d| **d == f32::from(end)).count() as f64 / valid.len().max(1) as f64;
        [share(*range.start()), share(*range.end())]
    }

    /// The smallest and largest valid disparity in pixels, or `None` if all pixels are invalid.
    pub fn range(&self) -> Option<RangeInclusive<f32>> {
        let valid = || self.pixels().iter().flatten().copied();
        Some(valid().min()?.into()..=valid().max()?.into())
    }

    /// The whole pixels that include the [`range`](DisparityMap::range), or `None` if all pixels are invalid.
    pub fn whole_range(&self) -> Option<RangeInclusive<i16>> {
        let range = self.range()?;
        Some(range.start().floor() as i16..=range.end().ceil() as i16)
    }

    /// The noise of the disparities in pixels: the standard deviation of their errors on smooth surfaces, estimated without
    /// the truth. `None` if too few pixels are valid.
    ///
    /// On a smooth surface, a disparity is the mean of those `spacing` pixels to both sides, apart from noise. With a
    /// spacing of at least the block, the three have noise of their own, and the difference has sqrt(3/2) times
    /// the noise. The larger half of the differences does not count: edges, curved surfaces and mismatches are among them.
    pub fn noise(&self, spacing: usize) -> Option<f64> {
        /// The standard deviation of the least half of normally distributed numbers, with a standard deviation of 1 in all.
        const LEAST_HALF: f64 = 0.377_7;
        const FEWEST: usize = 100;
        let mut differences: Vec<f64> = Vec::new();
        for line in self.rows() {
            let ahead = line.iter().skip(spacing).zip(line.iter().skip(2 * spacing));
            for (before, (at, after)) in line.iter().zip(ahead) {
                if let (Some(before), Some(at), Some(after)) = (before, at, after) {
                    let [before, at, after] = [before, at, after].map(|d| f64::from(f32::from(*d)));
                    differences.push((at - (before + after) / 2.0).powi(2));
                }
            }
        }
        differences.sort_unstable_by(f64::total_cmp);
        let kept = &differences[..differences.len() / 2];
        let square = kept.iter().sum::<f64>() / kept.len() as f64 / 1.5;
        (kept.len() >= FEWEST).then(|| square.sqrt() / LEAST_HALF)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disparity(pixels: f32) -> Option<Disparity> {
        Disparity::from_bits((pixels * 64.0) as i16)
    }

    fn map() -> DisparityMap {
        DisparityMap::new(
            3,
            2,
            vec![disparity(-2.5), None, disparity(60.0), disparity(0.0), disparity(511.984_4), disparity(-511.984_4)],
        )
    }

    /// A slanted plane up to column `edge`, and another one, with the sum of twelve uniform numbers as noise, and gaps.
    fn planes(edge: f64, noise: f64) -> DisparityMap {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let pixels = (0..200 * 150).map(|i| {
            let (u, v) = (f64::from(i % 200), f64::from(i / 200));
            let plane = if u < edge { 5.0 + 0.03 * u - 0.01 * v } else { 20.0 - 0.02 * u };
            let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            if uniform() < 0.1 { None } else { disparity((plane + noise * normal) as f32) }
        });
        DisparityMap::new(200, 150, pixels.collect())
    }

    #[test]
    fn noise_is_that_of_smooth_surfaces() {
        for expected in [0.03, 0.1, 0.5] {
            let [smooth, cut] = [200.0, 90.0].map(|edge| planes(edge, expected).noise(11).unwrap() / expected);
            assert!((smooth - 1.0).abs() < 0.05, "{smooth} of {expected}");
            // An eighth of the differences crosses the edge, so that more than half of the others count.
            assert!((1.1..1.25).contains(&cut), "{cut} of {expected}");
        }
        assert_eq!(map().noise(11), None);
    }

    #[test]
    fn pixels_are_rounded_to_the_nearest_step() {
        assert_eq!(DisparityMap::from_float(&map().to_float()), map());
        let pixels = FloatImage::new(3, 2, vec![0.0079, -0.0079, 0.0077, f32::NAN, 512.0, -600.0]);
        let bits = DisparityMap::from_float(&pixels).map(|d| d.map(Disparity::to_bits)).into_pixels();
        assert_eq!(bits, [Some(1), Some(-1), Some(0), None, None, None]);
    }

    #[test]
    fn a_longer_baseline_has_larger_disparities() {
        let pixels = map().times(4).map(|d| d.map(f32::from)).into_pixels();
        let most = 32767.0 / 64.0;
        assert_eq!(pixels, [Some(-10.0), None, Some(240.0), Some(0.0), Some(most), Some(-most)]);
        assert_eq!(map().times(1), map());
    }
}
