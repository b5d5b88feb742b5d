//! The camera, as far as it is known.

use multiscopic::Geometry;

/// The geometry that turns disparities into depth, as far as it is known.
#[derive(Clone, Copy, Debug)]
pub struct KnownCamera {
    /// Focal length in pixels.
    pub focal_px: Option<f64>,
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: Option<f64>,
    /// The point where the optical axis meets the images that are matched, in pixels.
    pub principal_point: [f64; 2],
    /// The negated disparity of a point at infinity, in pixels.
    pub doffs: f64,
}

impl KnownCamera {
    /// A camera of which nothing is known, whose images have `width` x `height` pixels.
    pub fn unknown((width, height): (u32, u32)) -> KnownCamera {
        let principal_point = [width, height].map(|side| (f64::from(side) - 1.0) / 2.0);
        KnownCamera { focal_px: None, baseline_mm: None, principal_point, doffs: 0.0 }
    }

    /// The geometry, if all of it is known.
    pub fn geometry(&self) -> Option<Geometry> {
        let KnownCamera { focal_px, baseline_mm, principal_point, doffs } = *self;
        Some(Geometry { focal_px: focal_px?, baseline_mm: baseline_mm?, principal_point, doffs })
    }
}
