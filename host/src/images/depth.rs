//! Depth maps.

use crate::images::{DisparityMap, FloatImage, Geometry};

/// The depth of every pixel in metres, +inf where it has none.
pub fn depth_map(disparities: &DisparityMap, geometry: &Geometry) -> FloatImage {
    let depth = |pixel: &Option<_>| pixel.and_then(|d| geometry.depth(d)).map_or(f32::INFINITY, |z| z as f32);
    disparities.map(depth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Disparity;

    #[test]
    fn what_has_no_depth_is_infinitely_far() {
        let geometry = Geometry { focal_px: 1000.0, baseline_mm: 50.0, principal_point: [0.0; 2], doffs: 0.0 };
        let map =
            DisparityMap::new(2, 2, vec![Disparity::from_bits(640), None, Disparity::from_bits(0), Disparity::from_bits(-64)]);
        assert_eq!(depth_map(&map, &geometry).pixels(), [5.0, f32::INFINITY, f32::INFINITY, f32::INFINITY]);
    }
}
