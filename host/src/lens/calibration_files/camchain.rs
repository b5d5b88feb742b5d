//! Kalibr's camera chain.

use super::yaml::Fields;
use crate::{
    error::{Error, Result},
    lens::{CameraModel, Lens, LensModel},
};

/// Whether a file has a camera of a chain: `cam0` and so on.
pub fn is_camchain(fields: &Fields) -> bool {
    cameras(fields).next().is_some()
}

fn cameras<'a>(fields: &Fields<'a>) -> impl Iterator<Item = &'a str> {
    fields.names().filter(|name| {
        let number = name.strip_prefix("cam").unwrap_or_default();
        !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
    })
}

pub fn read(fields: &Fields) -> Result<CameraModel> {
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
