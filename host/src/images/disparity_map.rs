//! What matching gives: the disparity of every pixel of the centre frame.

use std::ops::RangeInclusive;

use image::{ImageBuffer, Rgb, RgbImage};
use multiscopic_core::Disparity;

use super::{FloatImage, Raster, turbo};

/// A disparity for every pixel, `None` where there is none.
pub type DisparityMap = Raster<Option<Disparity>>;

impl DisparityMap {
    /// In pixels, +inf where there is none.
    pub fn to_float(&self) -> FloatImage {
        self.map(|pixel| pixel.map_or(f32::INFINITY, f32::from))
    }

    /// The map with the steps nearest to disparities in pixels; none where they are not finite or leave what a [`Disparity`] holds.
    pub fn from_float(pixels: &FloatImage) -> DisparityMap {
        let limits = f32::from(-i16::MAX)..=f32::from(i16::MAX);
        pixels.map(|d| {
            let steps = (d * Disparity::STEPS as f32).round();
            limits.contains(&steps).then(|| Disparity::from_bits(steps as i16)).flatten()
        })
    }

    /// The smallest and the largest disparity in pixels, `None` if no pixel has one.
    pub fn range(&self) -> Option<RangeInclusive<f32>> {
        let valid = || self.pixels().iter().flatten().copied();
        Some(valid().min()?.into()..=valid().max()?.into())
    }

    /// In the colours of Turbo: the far end of `range` (in pixels of disparity) is blue, the near end red, and black has no disparity.
    ///
    /// Disparities outside the range have the colour of its nearest end. Without a range it is the map's own.
    pub fn to_color(&self, range: Option<RangeInclusive<f32>>) -> RgbImage {
        let (far, near) = range.or_else(|| self.range()).map_or((0.0, 1.0), RangeInclusive::into_inner);
        let color = |d: Disparity| {
            // A range of one value must not divide by 0; any other is at least a step of 1/64.
            let nearness = (f32::from(d) - far) / (near - far).max(1e-6);
            turbo::color(f64::from(nearness))
        };
        let pixels = self.pixels().iter().flat_map(|pixel| pixel.map_or([0; 3], color)).collect();
        let (width, height) = (self.width() as u32, self.height() as u32);
        ImageBuffer::<Rgb<u8>, _>::from_raw(width, height, pixels).expect("three bytes for every pixel")
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

    #[test]
    fn steps_are_the_nearest_to_pixels() {
        assert_eq!(DisparityMap::from_float(&map().to_float()), map());
        let pixels = FloatImage::new(3, 2, vec![0.0079, -0.0079, 0.0077, f32::NAN, 512.0, -600.0]);
        let bits = DisparityMap::from_float(&pixels).map(|d| d.map(Disparity::to_bits)).into_pixels();
        assert_eq!(bits, [Some(1), Some(-1), Some(0), None, None, None]);
    }

    #[test]
    fn near_is_red_and_far_is_blue() {
        let map = DisparityMap::new(5, 1, [-4.0, 4.0, 0.0, 9.0].map(disparity).into_iter().chain([None]).collect());
        let [far, near, middle, nearer, none] = [0, 1, 2, 3, 4].map(|u| map.to_color(Some(-4.0..=4.0)).get_pixel(u, 0).0);
        assert!(far[2] > far[0] && near[0] > near[2] && middle[1] > 200, "{far:?} {middle:?} {near:?}");
        assert_eq!((nearer, none), (near, [0; 3]));
        // Its own range: -4 to 9.
        assert_eq!(map.to_color(None).get_pixel(3, 0).0, near);
        assert_ne!(map.to_color(None).get_pixel(1, 0).0, near);
    }

    #[test]
    fn colours_of_a_flat_or_empty_map() {
        assert_ne!(DisparityMap::filled(1, 1, disparity(3.0)).to_color(None).get_pixel(0, 0).0, [0; 3]);
        assert_eq!(DisparityMap::filled(1, 1, None).to_color(None).get_pixel(0, 0).0, [0; 3]);
        assert_eq!(DisparityMap::filled(1, 1, None).range(), None);
    }
}
