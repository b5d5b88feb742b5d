//! The camera geometry that turns disparities into depths and points.

use std::ops::RangeInclusive;

use multiscopic_core::Disparity;

use super::{DisparityMap, FloatImage};
use crate::{error::Warning, statistics::median};

/// The angles that lenses see along the longer side of an image, in degrees.
const VIEWS: RangeInclusive<f64> = 3.0..=150.0;
/// The median depths of captures, in millimetres.
const DEPTHS: RangeInclusive<f64> = 10.0..=1e6;

/// A pinhole camera and the baseline by which it was moved.
///
/// ```
/// use multiscopic::Geometry;
/// let geometry = Geometry { focal_px: 1000.0, baseline_mm: 20.0, principal_point: [319.5, 239.5], doffs: 0.0 };
/// assert_eq!(geometry.depth_mm(40.0), Some(500.0));
/// assert_eq!(geometry.depth_mm(0.0), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Focal length in pixels.
    pub focal_px: f64,
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: f64,
    /// The pixel at which the optical axis meets the image, `[cx, cy]` in pixels. The centre of the top left pixel is at
    /// `[0, 0]`.
    pub principal_point: [f64; 2],
    /// The negated disparity of a point at infinity, in pixels: 0 unless the images were shifted or cropped
    /// against each other.
    pub doffs: f64,
}

impl Geometry {
    /// The longest focal length in pixels, and the longest baseline in millimetres: ten kilometres.
    pub const MAX_LENGTH: f64 = 1e7;

    /// The geometry of images that are shrunk by a factor.
    pub fn shrunk(self, factor: u32) -> Geometry {
        let factor = f64::from(factor);
        let principal_point = shrunk_point(self.principal_point, factor);
        Geometry { focal_px: self.focal_px / factor, principal_point, doffs: self.doffs / factor, ..self }
    }

    /// The depth in metres, `focal_px * baseline / (d + doffs)`, or `None` if `d + doffs <= 0`.
    pub fn depth(&self, d: Disparity) -> Option<f64> {
        self.depth_mm(f32::from(d).into()).map(|depth| depth / 1000.0)
    }

    /// Returns the standard deviation of a depth in metres, of a disparity with a standard deviation in pixels and a baseline
    /// with one in millimetres: `Z sqrt((deviation / (d + doffs))^2 + (baseline_deviation / baseline)^2)`. `None` if
    /// `d + doffs <= 0`.
    pub fn depth_deviation(&self, d: Disparity, deviation_px: f64, baseline_deviation_mm: f64) -> Option<f64> {
        let shift = f64::from(f32::from(d)) + self.doffs;
        Some(self.depth(d)? * (deviation_px / shift).hypot(baseline_deviation_mm / self.baseline_mm))
    }

    /// Returns the [standard deviations](Geometry::depth_deviation) of the depths of a map in metres, +inf where a pixel has no
    /// depth. The `deviations` are those of the disparities in pixels.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn depth_deviations(&self, map: &DisparityMap, deviations: &FloatImage, baseline_deviation_mm: f64) -> FloatImage {
        assert_eq!((map.width(), map.height()), (deviations.width(), deviations.height()), "sizes");
        let metres = |(d, &deviation): (&Option<Disparity>, &f32)| {
            let deviation = d.and_then(|d| self.depth_deviation(d, deviation.into(), baseline_deviation_mm));
            deviation.map_or(f32::INFINITY, |metres| metres as f32)
        };
        FloatImage::new(map.width(), map.height(), map.pixels().iter().zip(deviations.pixels()).map(metres).collect())
    }

    /// The depths of a map in metres, +inf where a pixel has none.
    pub fn depths(&self, map: &DisparityMap) -> FloatImage {
        map.map(|pixel| pixel.and_then(|d| self.depth(d)).map_or(f32::INFINITY, |z| z as f32))
    }

    /// Returns the median depth of a map in millimetres. `None` if no pixel has a depth.
    pub fn median_depth_mm(&self, map: &DisparityMap) -> Option<f64> {
        let depths: Vec<f64> = map.pixels().iter().flatten().filter_map(|&d| self.depth(d)).collect();
        (!depths.is_empty()).then(|| 1000.0 * median(depths))
    }

    /// Warns of a focal length that is none in pixels, and of a baseline that is none in millimetres, by the angle that the
    /// images see and the depths of a map.
    pub fn warnings(&self, map: &DisparityMap) -> Vec<Warning> {
        let side = map.width().max(map.height()) as f64;
        let degrees = 2.0 * (side / 2.0 / self.focal_px).atan().to_degrees();
        if !VIEWS.contains(&degrees) {
            return vec![Warning::FocalLength { focal_px: self.focal_px, degrees }];
        }
        let depth_mm = self.median_depth_mm(map).filter(|depth| !DEPTHS.contains(depth));
        depth_mm.map(|depth_mm| Warning::Depths { depth_mm, baseline_mm: self.baseline_mm }).into_iter().collect()
    }

    /// The depth in millimetres of a disparity in pixels, or `None` if `d + doffs <= 0`.
    pub fn depth_mm(&self, d: f64) -> Option<f64> {
        let shift = d + self.doffs;
        (shift > 0.0).then(|| self.focal_px * self.baseline_mm / shift)
    }

    /// The point seen by pixel `(u, v)`, in metres from the centre camera: x to the right, y down, z along
    /// the optical axis. `None` if the pixel has no depth.
    pub fn point(&self, u: usize, v: usize, d: Disparity) -> Option<[f64; 3]> {
        let z = self.depth(d)?;
        let [cx, cy] = self.principal_point;
        Some([(u as f64 - cx) * z / self.focal_px, (v as f64 - cy) * z / self.focal_px, z])
    }
}

/// The place of a point in images that are shrunk by a factor: the top left pixel's centre is at `[0, 0]` in both.
pub(crate) fn shrunk_point(point: [f64; 2], factor: f64) -> [f64; 2] {
    point.map(|at| (at + 0.5) / factor - 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEOMETRY: Geometry = Geometry { focal_px: 500.0, baseline_mm: 40.0, principal_point: [160.0, 120.0], doffs: 2.0 };

    fn disparity(pixels: i16) -> Disparity {
        Disparity::from_bits(pixels * 64).unwrap()
    }

    #[test]
    fn depth_in_metres() {
        assert_eq!(GEOMETRY.depth(disparity(8)), Some(2.0));
        assert_eq!(GEOMETRY.depth(disparity(-1)), Some(20.0));
        assert_eq!(GEOMETRY.depth(disparity(-2)), None);
        assert_eq!(GEOMETRY.depth(disparity(-3)), None);
    }

    /// The derivative of depth by disparity and by baseline, by differences.
    #[test]
    fn deviations_of_depth_are_derivatives_times_deviations() {
        let of_disparity = (GEOMETRY.depth_mm(8.01).unwrap() - GEOMETRY.depth_mm(7.99).unwrap()).abs() / 0.02 / 1000.0;
        let longer = Geometry { baseline_mm: 41.0, ..GEOMETRY };
        let of_baseline = longer.depth(disparity(8)).unwrap() - GEOMETRY.depth(disparity(8)).unwrap();
        for (px, mm, expected) in [(0.3, 0.0, 0.3 * of_disparity), (0.0, 0.2, 0.2 * of_baseline)] {
            let deviation = GEOMETRY.depth_deviation(disparity(8), px, mm).unwrap();
            assert!((deviation - expected).abs() < 1e-4 * expected, "{deviation}, not {expected}");
        }
        assert_eq!(GEOMETRY.depth_deviation(disparity(8), 4.0, 16.0), Some(2.0 * 0.4f64.hypot(0.4)));
        assert_eq!(GEOMETRY.depth_deviation(disparity(-2), 1.0, 1.0), None);
    }

    #[test]
    fn lengths_in_other_units_are_warned_of() {
        let map = DisparityMap::new(640, 1, vec![Some(disparity(18)); 640]);
        let warned = |focal_px, baseline_mm| Geometry { focal_px, baseline_mm, ..GEOMETRY }.warnings(&map);
        assert_eq!(warned(500.0, 40.0), []);
        let fitting = GEOMETRY.median_depth_mm(&map).expect("all pixels have a depth");
        assert!((fitting - 1000.0).abs() < 1e-9, "{fitting}");
        assert!(matches!(warned(4.0, 40.0)[..], [Warning::FocalLength { .. }]), "in millimetres");
        assert!(matches!(warned(500.0, 0.02)[..], [Warning::Depths { .. }]), "in metres");
    }

    #[test]
    fn shrunk_images_have_the_same_depths() {
        let half = GEOMETRY.shrunk(2);
        assert_eq!((half.depth(disparity(4)), half.principal_point), (GEOMETRY.depth(disparity(8)), [79.75, 59.75]));
    }

    #[test]
    fn points_lie_on_their_ray() {
        assert_eq!(GEOMETRY.point(160, 120, disparity(8)), Some([0.0, 0.0, 2.0]));
        assert_eq!(GEOMETRY.point(410, 70, disparity(8)), Some([1.0, -0.2, 2.0]));
        assert_eq!(GEOMETRY.point(0, 0, disparity(-2)), None);
    }

    #[test]
    fn a_pixel_without_depth_is_infinitely_far() {
        let geometry = Geometry { focal_px: 1000.0, baseline_mm: 50.0, principal_point: [0.0; 2], doffs: 0.0 };
        let map = DisparityMap::new(2, 2, vec![Some(disparity(10)), None, Some(disparity(0)), Some(disparity(-1))]);
        assert_eq!(geometry.depths(&map).pixels(), [5.0, f32::INFINITY, f32::INFINITY, f32::INFINITY]);
    }
}
