//! The layouts of calibration files: OpenCV, ROS, Kalibr, and `camera.toml`.

use std::{fmt::Write, path::Path};

use serde::{Deserialize, Serialize};

use super::yaml::{Field, Fields};
use crate::{
    error::{Error, Result},
    files::{input, output},
    lens::{CameraModel, Lens, LensModel},
};

/// ROS's names and those of OpenCV's samples.
const MATRIX: [&str; 4] = ["camera_matrix", "K", "intrinsic_matrix", "mtx"];
const COEFFICIENTS: [&str; 5] = ["distortion_coefficients", "dist_coeffs", "D", "distortion_coeffs", "dist"];

pub fn read_matrix_file(fields: &Fields) -> Result<CameraModel> {
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
pub fn is_camchain(fields: &Fields) -> bool {
    cameras(fields).next().is_some()
}

fn cameras<'a>(fields: &Fields<'a>) -> impl Iterator<Item = &'a str> {
    fields.names().filter(|name| {
        let number = name.strip_prefix("cam").unwrap_or_default();
        !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
    })
}

pub fn read_camchain(fields: &Fields) -> Result<CameraModel> {
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
pub fn write_camera_info(camera: &CameraModel, path: &Path) -> Result<()> {
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

pub fn read_camera_toml(path: &Path) -> Result<CameraModel> {
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
pub fn write_camera_toml(camera: &CameraModel, path: &Path) -> Result<()> {
    let CameraModel { size, focal_px, principal_point, lens } = *camera;
    let (model, coefficients) = (lens.model().name().into(), lens.coefficients().to_vec());
    output::write_toml(path, &CameraToml { size, focal_px, principal_point, model, coefficients })
}
