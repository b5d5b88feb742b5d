//! The files in which calibrations are kept.
//!
//! A file whose name ends in `.toml` is a `camera.toml`. Others are YAML, and their contents tell which program wrote them:
//! ROS's `camera_info` and OpenCV's `FileStorage`, which have a camera matrix and distortion coefficients, or Kalibr's camera
//! chain. `camera.toml` and `camera_info` are also written.

mod yaml;

use std::{fmt::Write, path::Path};

use serde::{Deserialize, Serialize};

use super::{CameraModel, Lens, LensModel};
use crate::{
    error::{Error, Result},
    files::{input, output},
};

use yaml::{Field, Fields};

impl CameraModel {
    /// The name of the file in a captured folder.
    pub const FILE_NAME: &str = "camera.toml";

    /// Reads a calibration: a `camera.toml` ([`save`](CameraModel::save)), a YAML file of ROS (`camera_info`) or OpenCV
    /// (`FileStorage`, also as JSON), or a camera chain of Kalibr.
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
                let document = yaml::Document::parse(path, &text)?;
                let fields = document.fields()?;
                match is_camchain(&fields) {
                    true => read_camchain(&fields)?,
                    false => read_matrix_file(&fields)?,
                }
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
    /// model = "plumb_bob"                     # or rational, equidistant
    /// coefficients = [-0.25, 0.08, 0.0, 0.0, -0.01]  # k1 k2 p1 p2 k3; rational: and k4 k5 k6; equidistant: k1 k2 k3 k4
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

/// ROS's names and those of OpenCV's samples.
const MATRIX: [&str; 4] = ["camera_matrix", "K", "intrinsic_matrix", "mtx"];
const COEFFICIENTS: [&str; 5] = ["distortion_coefficients", "dist_coeffs", "D", "distortion_coeffs", "dist"];

fn read_matrix_file(fields: &Fields) -> Result<CameraModel> {
    if fields.field(&MATRIX).is_none() && fields.field(&COEFFICIENTS).is_none() {
        let names: Vec<&str> = fields.names().take(5).collect();
        let found = if names.is_empty() { "no fields".into() } else { format!("the fields {}", names.join(", ")) };
        let expected = "camera_matrix and distortion_coefficients (ROS, OpenCV) or cam0 (Kalibr)";
        return Err(Error::format(fields.path, found, expected));
    }
    let (focal_px, principal_point) = camera_matrix(&fields.required(&MATRIX)?)?;
    Ok(CameraModel { size: size(fields)?, focal_px, principal_point, lens: lens(fields)? })
}

/// The focal lengths and the principal point.
fn camera_matrix(field: &Field) -> Result<([f64; 2], [f64; 2])> {
    const EXPECTED: &str = "fx 0 cx, 0 fy cy, 0 0 1";
    let numbers = field.numbers()?;
    let Ok([fx, skew, cx, a, fy, cy, b, c, one]) = <[f64; 9]>::try_from(numbers) else {
        return Err(field.error(format!("{} numbers", field.numbers()?.len()), format!("9: {EXPECTED}")));
    };
    if skew != 0.0 {
        return Err(field.error(format!("a skew of {skew}"), "a camera without skew"));
    }
    if [a, b, c, one] != [0.0, 0.0, 0.0, 1.0] {
        return Err(field.error("no camera matrix", EXPECTED));
    }
    Ok(([fx, fy], [cx, cy]))
}

/// Width and height, if the file has them.
fn size(fields: &Fields) -> Result<Option<[usize; 2]>> {
    let [width, height] = ["image_width", "image_height"].map(|name| fields.field(&[name]));
    match (width, height) {
        (None, None) => Ok(None),
        (Some(width), Some(height)) => Ok(Some([width.pixels()?, height.pixels()?])),
        (Some(_), None) => fields.required(&["image_height"]).map(|_| None),
        (None, Some(_)) => fields.required(&["image_width"]).map(|_| None),
    }
}

fn lens(fields: &Fields) -> Result<Lens> {
    let field = fields.required(&COEFFICIENTS)?;
    let mut coefficients = field.numbers()?;
    let named = match fields.field(&["distortion_model"]) {
        Some(field) => {
            let name = field.text()?;
            let model = LensModel::named(name);
            Some(model.ok_or_else(|| field.error(format!("{name:?}"), "plumb_bob, rational_polynomial or equidistant"))?)
        }
        None => None,
    };
    let is_fisheye = match fields.field(&["fisheye_model"]) {
        Some(field) => Some(field.number()? != 0.0),
        None => None,
    };
    let model = match (named, is_fisheye, coefficients.len()) {
        (Some(model), Some(is_fisheye), _) if is_fisheye != (model == LensModel::Equidistant) => {
            let found = format!("{model} in distortion_model, but fisheye_model = {}", u8::from(is_fisheye));
            return Err(Error::format(fields.path, found, "one model"));
        }
        (Some(model), ..) => model,
        (None, Some(true), _) => LensModel::Equidistant,
        (None, _, 4 | 5) => LensModel::PlumbBob,
        (None, _, 8 | 12 | 14) => LensModel::Rational,
        (None, _, count) => return Err(field.error(format!("{count} coefficients"), "4, 5, 8, 12 or 14, as OpenCV has")),
    };
    // OpenCV's further coefficients: thin prisms (s1 to s4) and a tilted sensor.
    if model == LensModel::Rational && matches!(coefficients.len(), 12 | 14) {
        if coefficients[8..].iter().any(|&coefficient| coefficient != 0.0) {
            return Err(field.error("a thin prism or a tilted sensor", "at most the 8 coefficients k1 k2 p1 p2 k3 k4 k5 k6"));
        }
        coefficients.truncate(8);
    }
    if model == LensModel::PlumbBob && coefficients.len() == 4 {
        coefficients.push(0.0);
    }
    Lens::new(model, &coefficients).map_err(|error| field.error(error.to_string(), "those of the model"))
}

/// Returns true if a file has a camera of a chain: `cam0` and so on.
fn is_camchain(fields: &Fields) -> bool {
    cameras(fields).next().is_some()
}

fn cameras<'a>(fields: &Fields<'a>) -> impl Iterator<Item = &'a str> {
    fields.names().filter(|name| {
        let number = name.strip_prefix("cam").unwrap_or_default();
        !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
    })
}

fn read_camchain(fields: &Fields) -> Result<CameraModel> {
    let names: Vec<&str> = cameras(fields).collect();
    let &[name] = &names[..] else {
        let found = format!("{} cameras ({})", names.len(), names.join(", "));
        return Err(Error::format(fields.path, found, "one: keep the one that takes the images"));
    };
    let camera = fields.required(&[name])?.fields()?;
    let model = camera.required(&["camera_model"])?;
    if model.text()? != "pinhole" {
        return Err(model.error(format!("{:?}", model.text()?), "pinhole"));
    }
    let intrinsics = camera.required(&["intrinsics"])?;
    let numbers = intrinsics.numbers()?;
    let &[fx, fy, cx, cy] = &numbers[..] else {
        return Err(intrinsics.error(format!("{} numbers", numbers.len()), "4: fx fy cx cy"));
    };
    let resolution = camera.required(&["resolution"])?;
    let size = resolution.numbers()?;
    let whole = |side: f64| (side >= 0.0 && side.fract() == 0.0).then_some(side as usize);
    let size = match &size[..] {
        &[width, height] => whole(width).zip(whole(height)),
        _ => None,
    };
    let Some((width, height)) = size else {
        return Err(resolution.error("no size", "two whole numbers of pixels: width and height"));
    };
    let distortion = camera.required(&["distortion_model"])?;
    let coefficients = camera.required(&["distortion_coeffs"])?;
    let (model, given) = (distortion.text()?, coefficients.numbers()?);
    let (model, expected, further) = match model {
        "radtan" => (LensModel::PlumbBob, 4, Some(0.0)),
        "equidistant" => (LensModel::Equidistant, 4, None),
        "none" => (LensModel::PlumbBob, 0, None),
        _ => return Err(distortion.error(format!("{model:?}"), "radtan, equidistant or none")),
    };
    if given.len() != expected {
        let expected = format!("{expected} for {}", distortion.text()?);
        return Err(coefficients.error(format!("{} coefficients", given.len()), expected));
    }
    let lens = match expected {
        0 => Lens::IDEAL,
        _ => {
            let all: Vec<f64> = given.into_iter().chain(further).collect();
            Lens::new(model, &all).map_err(|error| coefficients.error(error.to_string(), "those of the model"))?
        }
    };
    Ok(CameraModel { size: Some([width, height]), focal_px: [fx, fy], principal_point: [cx, cy], lens })
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
        LensModel::Rational => "rational_polynomial",
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
