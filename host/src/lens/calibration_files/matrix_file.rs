//! Calibrations by a camera matrix and distortion coefficients: ROS's `camera_info` and OpenCV's `FileStorage`.

use super::yaml::{Field, Fields};
use crate::{
    error::{Error, Result},
    lens::{CameraModel, Lens, LensModel},
};

/// ROS's names and those of OpenCV's samples.
const MATRIX: [&str; 4] = ["camera_matrix", "K", "intrinsic_matrix", "mtx"];
const COEFFICIENTS: [&str; 5] = ["distortion_coefficients", "dist_coeffs", "D", "distortion_coeffs", "dist"];

pub fn read(fields: &Fields) -> Result<CameraModel> {
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
