//! The camera's geometry, for depth and point clouds.

use clap::Args;
use multiscopic::{Frames, Geometry, Rig};

use super::value::{finite, point, positive};

/// The geometry that turns disparities into depth.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Camera (for --depth and --ply; overrides rig.toml)")]
pub struct GeometryOptions {
    /// Focal length in pixels
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Distance the camera moved from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    /// Negated disparity of a point at infinity, in pixels [default: 0]
    #[arg(long, value_name = "PX", value_parser = finite, allow_negative_numbers = true)]
    doffs: Option<f64>,

    /// Point where the optical axis meets the image, in pixels from the centre of the top left pixel [default: the
    /// middle of the image]
    #[arg(long, value_name = "CX,CY", value_parser = point, allow_negative_numbers = true)]
    principal_point: Option<[f64; 2]>,
}

impl GeometryOptions {
    /// The geometry of `frames`: options first, then `rig`. `None` if the focal length or the baseline is unknown.
    pub fn geometry(&self, rig: Option<&Rig>, frames: &Frames) -> Option<Geometry> {
        let middle = || [frames.width(), frames.height()].map(|side| (side as f64 - 1.0) / 2.0);
        Some(Geometry {
            focal_px: self.focal_px.or(rig.and_then(|rig| rig.focal_px))?,
            baseline_mm: self.baseline_mm.or(rig.map(|rig| rig.baseline_mm))?,
            principal_point: self.principal_point.or(rig.map(|rig| rig.principal_point)).unwrap_or_else(middle),
            doffs: self.doffs.or(rig.map(|rig| rig.doffs)).unwrap_or_default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;
    use multiscopic::files::{FrameFiles, Provenance};

    use super::*;

    #[test]
    fn options_override_the_rig() {
        let frames = Frames::new(GrayImage::new(640, 480));
        let no_options = GeometryOptions { focal_px: None, baseline_mm: None, doffs: None, principal_point: None };
        assert_eq!(no_options.geometry(None, &frames), None);
        let rig = Rig {
            focal_px: Some(500.0),
            baseline_mm: 40.0,
            principal_point: [1.0, 2.0],
            doffs: 3.0,
            images: FrameFiles::default(),
            capture: Provenance::default(),
        };
        assert_eq!(no_options.geometry(Some(&rig), &frames), rig.geometry());

        let given = GeometryOptions { focal_px: Some(700.0), baseline_mm: Some(20.0), ..no_options };
        let expected = Geometry { focal_px: 700.0, baseline_mm: 20.0, principal_point: [1.0, 2.0], doffs: 3.0 };
        assert_eq!(given.geometry(Some(&rig), &frames), Some(expected));
        let unknown = Rig { focal_px: None, ..rig };
        assert_eq!(no_options.geometry(Some(&unknown), &frames), None);
        assert_eq!(given.geometry(Some(&unknown), &frames), Some(expected));
        let middle = Geometry { principal_point: [319.5, 239.5], doffs: 0.0, ..expected };
        assert_eq!(given.geometry(None, &frames), Some(middle));
    }
}
