//! The camera geometry that turns disparities into depths and points.

use multiscopic_core::Disparity;

use super::{DisparityMap, FloatImage};

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

    /// The depth in metres, `focal_px * baseline / (d + doffs)`, or `None` if `d + doffs <= 0`.
    pub fn depth(&self, d: Disparity) -> Option<f64> {
        self.depth_mm(f32::from(d).into()).map(|depth| depth / 1000.0)
    }

    /// The depths of a map in metres, +inf where a pixel has none.
    pub fn depths(&self, map: &DisparityMap) -> FloatImage {
        map.map(|pixel| pixel.and_then(|d| self.depth(d)).map_or(f32::INFINITY, |z| z as f32))
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
