//! The files in which calibrations are kept.
//!
//! A file whose name ends in `.toml` is a `camera.toml`. Others are YAML, JSON, or ROS's INI, which is turned into YAML first.
//! One table of names (`camera_fields`) finds the camera in the files of ROS, OpenCV, Kalibr and others. `camera.toml` and
//! ROS's `camera_info` are also written.

mod camera_fields;
mod ini;
mod yaml;

use std::{fmt::Write, path::Path};

use serde::{Deserialize, Serialize};

use super::{CameraModel, Lens, LensModel};
use crate::{
    error::{Error, Result},
    files::{input, output},
};

impl CameraModel {
    /// The name of the file in a captured folder.
    pub const FILE_NAME: &str = "camera.toml";

    /// Reads a calibration: a `camera.toml` ([`save`](CameraModel::save)), a YAML file of ROS (`camera_info`, or the message
    /// itself) or OpenCV (`FileStorage`, also as JSON), a camera chain of Kalibr with one camera, or ROS's INI file.
    ///
    /// Four coefficients are taken for `k1 k2 p1 p2` unless the file names another model. OpenCV's files do not name a
    /// fisheye, unless they have `fisheye_model: 1` as those of its sample program.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if the file is no calibration, is incomplete or contradicts itself, or has
    /// another camera model.
    pub fn read(path: &Path) -> Result<CameraModel> {
        if path.is_dir() {
            return Err(Error::format(path, "a folder", "the calibration of one camera: name the file in it"));
        }
        let camera = match is_toml(path) {
            true => read_camera_toml(path)?,
            false => {
                let text = input::read_text(path)?;
                let text = ini::as_yaml(path, &text)?.unwrap_or(text);
                camera_fields::read(yaml::Document::parse(path, &text)?.fields()?)?
            }
        };
        camera.check(path)?;
        Ok(camera)
    }

    /// Writes ROS's `camera_info` YAML if the name of the file ends in `.yaml` or `.yml`, otherwise a `camera.toml`:
    ///
    /// ```toml
    /// size = [640, 480]                       # of the images, in pixels; optional
    /// focal_px = [1180.5, 1181.0]             # fx, fy
    /// principal_point = [319.5, 239.5]        # cx, cy; the centre of the top left pixel is [0, 0]
    /// model = "plumb_bob"                     # or rational, thin_prism, equidistant
    /// coefficients = [-0.25, 0.08, 0.0, 0.0, -0.01]  # k1 k2 p1 p2 k3; rational: and k4 k5 k6; equidistant: k1 k2 k3 k4;
    ///                                         # thin_prism: those of rational, s1 s2 s3 s4 tau_x tau_y
    /// ```
    ///
    /// # Errors
    /// [`Error::Format`] if a value is out of range or the name ends otherwise, and [`Error::Write`]. Any previous version of
    /// the file is unchanged.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.check(path)?;
        CameraModel::check_name(path)?;
        if is_toml(path) { write_camera_toml(self, path) } else { write_camera_info(self, path) }
    }

    /// Refuses a name for [`save`](CameraModel::save) that ends neither in `.toml` nor in `.yaml` or `.yml`.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn check_name(path: &Path) -> Result<()> {
        let is_yaml =
            path.extension().is_some_and(|extension| ["yaml", "yml"].iter().any(|yaml| extension.eq_ignore_ascii_case(yaml)));
        match is_toml(path) || is_yaml {
            true => Ok(()),
            false => Err(Error::format(path, "the name of a calibration", "one that ends in .toml, or in .yaml for ROS")),
        }
    }

    /// Refuses images that are not as large as those of the calibration in `path`.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn check_size(&self, path: &Path, [width, height]: [usize; 2]) -> Result<()> {
        match self.size {
            Some([w, h]) if [w, h] != [width, height] => {
                let expected = format!("{width}x{height} as the images: calibrate with images of this size");
                Err(Error::format(path, format!("a calibration of {w}x{h} pixels"), expected))
            }
            _ => Ok(()),
        }
    }

    fn check(&self, path: &Path) -> Result<()> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point);
        for (name, value) in [("fx", fx), ("fy", fy)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::format(path, format!("a focal length {name} of {value} pixels"), "a length above 0"));
            }
        }
        if !(0.5..2.0).contains(&(fx / fy)) {
            let found = format!("focal lengths of {fx} and {fy} pixels");
            return Err(Error::format(path, found, "nearly the same, as pixels are nearly square"));
        }
        if ![cx, cy].iter().all(|coordinate| coordinate.is_finite()) {
            return Err(Error::format(path, format!("a principal point at {cx}, {cy}"), "finite numbers"));
        }
        let Some([width, height]) = self.size else { return Ok(()) };
        let sides = 1..=input::MAX_SIDE as usize;
        if !sides.contains(&width) || !sides.contains(&height) {
            let expected = format!("1 to {} pixels on each side", input::MAX_SIDE);
            return Err(Error::format(path, format!("images of {width}x{height} pixels"), expected));
        }
        let inside = |coordinate: f64, side: usize| (0.0..side as f64).contains(&coordinate);
        if !inside(cx, width) || !inside(cy, height) {
            let found = format!("a principal point at {cx}, {cy}");
            return Err(Error::format(path, found, format!("one inside the image of {width}x{height} pixels")));
        }
        // Halfway to the corners, every lens still sees something.
        let halfway = [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]]
            .map(|[u, v]| [(u as f64 + cx) / 2.0, (v as f64 + cy) / 2.0]);
        if let Some([u, v]) = halfway.into_iter().find(|&pixel| self.direction(pixel).is_none()) {
            let found = format!("coefficients of the lens that fold the image before it reaches the pixel {u:.0}, {v:.0}");
            let expected = format!("those of a lens for the whole image of {width}x{height} pixels, in the order of the model");
            return Err(Error::format(path, found, expected));
        }
        Ok(())
    }
}

fn is_toml(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

/// Writes the YAML that `camera_calibration_parsers` of ROS writes. The projection is that of undistorted images with the
/// horizontal focal length, as [`Undistortion`](crate::lens::Undistortion) makes them.
fn write_camera_info(camera: &CameraModel, path: &Path) -> Result<()> {
    let CameraModel { size, focal_px: [fx, fy], principal_point: [cx, cy], lens } = *camera;
    let mut yaml = String::new();
    if let Some([width, height]) = size {
        let _ = writeln!(yaml, "image_width: {width}\nimage_height: {height}");
    }
    yaml += "camera_name: camera\n";
    yaml += &matrix("camera_matrix", 3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    let model = match lens.model() {
        LensModel::PlumbBob => "plumb_bob",
        LensModel::Rational | LensModel::ThinPrism => "rational_polynomial",
        LensModel::Equidistant => "equidistant",
    };
    let _ = writeln!(yaml, "distortion_model: {model}");
    yaml += &matrix("distortion_coefficients", 1, lens.coefficients().len(), lens.coefficients());
    yaml += &matrix("rectification_matrix", 3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    yaml += &matrix("projection_matrix", 3, 4, &[fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    output::write(path, |writer| writer.write_all(yaml.as_bytes()))
}

fn matrix(name: &str, rows: usize, columns: usize, data: &[f64]) -> String {
    let data: Vec<String> = data.iter().map(|number| format!("{number:?}")).collect();
    format!("{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{}]\n", data.join(", "))
}

/// The contents of a `camera.toml`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraToml {
    size: Option<[usize; 2]>,
    focal_px: [f64; 2],
    principal_point: [f64; 2],
    model: String,
    coefficients: Vec<f64>,
}

fn read_camera_toml(path: &Path) -> Result<CameraModel> {
    input::read_toml::<CameraToml>(path, "a camera.toml")?.model(path)
}

impl CameraToml {
    /// The camera, if its values are in range. `path` is the file that they are from.
    pub(crate) fn model(self, path: &Path) -> Result<CameraModel> {
        let CameraToml { size, focal_px, principal_point, model, coefficients } = self;
        let Some(model) = LensModel::ALL.into_iter().find(|known| known.name() == model) else {
            let names = LensModel::ALL.map(LensModel::name).join(", ");
            return Err(Error::format(path, format!("model = {model:?}"), format!("one of {names}")));
        };
        let lens =
            Lens::new(model, &coefficients).map_err(|error| Error::format(path, error.to_string(), "those of the model"))?;
        let camera = CameraModel { size, focal_px, principal_point, lens };
        camera.check(path)?;
        Ok(camera)
    }
}

/// Writes a `camera.toml`.
fn write_camera_toml(camera: &CameraModel, path: &Path) -> Result<()> {
    let CameraModel { size, focal_px, principal_point, lens } = *camera;
    let (model, coefficients) = (lens.model().name().into(), lens.coefficients().to_vec());
    output::write_toml(path, &CameraToml { size, focal_px, principal_point, model, coefficients })
}

#[cfg(test)]
mod tests;
