//! The camera's geometry, for depth and point clouds.

use clap::Args;
use multiscopic::{Error, Frames, Geometry, Result, Rig, lens::LensFile};

use super::value::{finite, length, point};

/// The geometry that turns disparities into depth.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Camera (for depth; overrides rig.toml)")]
pub struct GeometryOptions {
    /// Focal length in pixels
    #[arg(long, value_name = "PX", value_parser = length, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Distance the camera moved from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = length, allow_negative_numbers = true)]
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
    /// The options that would give what is missing for depth.
    fn missing(&self, rig: Option<&Rig>, lens: Option<&LensFile>) -> Vec<&'static str> {
        let has_focal = self.focal_px.is_some() || lens.is_some() || rig.is_some_and(|rig| rig.focal_px.is_some());
        let has_baseline = self.baseline_mm.is_some() || rig.is_some_and(|rig| rig.baseline_mm.is_some());
        let options = [("--focal-px (or --lens)", has_focal), ("--baseline-mm", has_baseline)];
        options.into_iter().filter_map(|(option, is_there)| (!is_there).then_some(option)).collect()
    }

    /// Refuses `what`, which needs the geometry, if something of it is missing.
    pub fn refuse_missing(&self, what: &str, rig: Option<&Rig>, lens: Option<&LensFile>) -> Result<()> {
        match &self.missing(rig, lens)[..] {
            [] => Ok(()),
            missing => Err(Error::Usage(format!(
                "{what} needs the focal length and the baseline: give {}, or a rig.toml with it",
                missing.join(" and ")
            ))),
        }
    }

    /// The geometry of `frames`: options first, then `rig`, then `lens`, which the options and the rig must not contradict. Only
    /// the lens's principal point comes before the rig's, since it is that of the undistorted images. `None` if the focal length
    /// or the baseline is unknown.
    pub fn geometry(&self, rig: Option<&Rig>, lens: Option<&LensFile>, frames: &Frames) -> Result<Option<Geometry>> {
        let rig_focal_px = rig.and_then(|rig| rig.focal_px);
        if let Some(lens) = lens {
            match self.focal_px {
                Some(_) => lens.check_focal(self.focal_px, "--focal-px")?,
                None => lens.check_focal(rig_focal_px, Rig::FILE_NAME)?,
            }
        }
        let focal_px = self.focal_px.or(rig_focal_px).or(lens.map(LensFile::focal_px));
        let baseline_mm = self.baseline_mm.or(rig.and_then(|rig| rig.baseline_mm));
        let (Some(focal_px), Some(baseline_mm)) = (focal_px, baseline_mm) else { return Ok(None) };
        let middle = || [frames.width(), frames.height()].map(|side| (side as f64 - 1.0) / 2.0);
        let lens_point = lens.map(|lens| lens.principal_point(frames.size()));
        let principal_point = self.principal_point.or(lens_point).or(rig.and_then(|rig| rig.principal_point));
        Ok(Some(Geometry {
            focal_px,
            baseline_mm,
            principal_point: principal_point.unwrap_or_else(middle),
            doffs: self.doffs.or(rig.map(|rig| rig.doffs)).unwrap_or_default(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;
    use multiscopic::{
        CameraModel, Lens,
        files::{FrameFiles, Provenance},
        lens::Mount,
    };

    use super::*;

    #[test]
    fn options_override_the_rig() {
        let frames = Frames::new(GrayImage::new(640, 480));
        let no_options = GeometryOptions { focal_px: None, baseline_mm: None, doffs: None, principal_point: None };
        assert_eq!(no_options.geometry(None, None, &frames).unwrap(), None);
        assert_eq!(no_options.missing(None, None), ["--focal-px (or --lens)", "--baseline-mm"]);
        let rig = Rig {
            focal_px: Some(500.0),
            baseline_mm: Some(40.0),
            principal_point: Some([1.0, 2.0]),
            doffs: 3.0,
            lens: None,
            mount_rotation_deg: None,
            images: FrameFiles::default(),
            alignment: None,
            capture: Provenance::default(),
        };
        assert_eq!(no_options.geometry(Some(&rig), None, &frames).unwrap(), rig.geometry(frames.size()));

        let given = GeometryOptions { focal_px: Some(700.0), baseline_mm: Some(20.0), ..no_options };
        let expected = Geometry { focal_px: 700.0, baseline_mm: 20.0, principal_point: [1.0, 2.0], doffs: 3.0 };
        assert_eq!(given.geometry(Some(&rig), None, &frames).unwrap(), Some(expected));
        let unknown = Rig { focal_px: None, ..rig };
        assert_eq!(no_options.geometry(Some(&unknown), None, &frames).unwrap(), None);
        assert_eq!(no_options.missing(Some(&unknown), None), ["--focal-px (or --lens)"]);
        assert!(given.missing(Some(&unknown), None).is_empty());
        assert_eq!(given.geometry(Some(&unknown), None, &frames).unwrap(), Some(expected));
        let middle = Geometry { principal_point: [319.5, 239.5], doffs: 0.0, ..expected };
        assert_eq!(given.geometry(None, None, &frames).unwrap(), Some(middle));

        let camera = CameraModel { size: None, focal_px: [503.0, 504.0], principal_point: [330.0, 250.0], lens: Lens::IDEAL };
        let lens = LensFile { path: "camera.toml".into(), camera, mount: Mount::SQUARE };
        let of_lens = Geometry { focal_px: 503.0, baseline_mm: 40.0, principal_point: [330.0, 250.0], doffs: 3.0 };
        assert_eq!(no_options.geometry(Some(&unknown), Some(&lens), &frames).unwrap(), Some(of_lens));
        let of_both = Geometry { focal_px: 500.0, ..of_lens };
        let known = Rig { focal_px: Some(500.0), ..unknown };
        assert_eq!(no_options.geometry(Some(&known), Some(&lens), &frames).unwrap(), Some(of_both));
        let error = given.geometry(Some(&known), Some(&lens), &frames).unwrap_err().to_string();
        assert!(error.contains("--focal-px gives a focal length of 700 pixels, but camera.toml one of 503.0"), "{error}");
        let other = Rig { focal_px: Some(480.0), ..known };
        let error = no_options.geometry(Some(&other), Some(&lens), &frames).unwrap_err().to_string();
        assert!(error.contains("rig.toml gives a focal length of 480 pixels"), "{error}");
    }
}
