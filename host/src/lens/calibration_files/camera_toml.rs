//! `camera.toml`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{
    error::{Error, Result},
    files::toml_file,
    lens::{CameraModel, Lens, LensModel},
};

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

pub fn read(path: &Path) -> Result<CameraModel> {
    toml_file::read::<CameraToml>(path, "a camera.toml")?.model(path)
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
pub fn write(camera: &CameraModel, path: &Path) -> Result<()> {
    let CameraModel { size, focal_px, principal_point, lens } = *camera;
    let (model, coefficients) = (lens.model().name().into(), lens.coefficients().to_vec());
    toml_file::write(path, &CameraToml { size, focal_px, principal_point, model, coefficients })
}
