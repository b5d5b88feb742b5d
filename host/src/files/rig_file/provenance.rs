//! How a rig was captured.

use serde::{Deserialize, Serialize};

/// The `[capture]` of a `rig.toml`: how the rig was captured, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The camera and its settings.
    pub camera: Option<String>,
    /// The stage that moved the camera.
    pub stage: Option<String>,
    /// The date of the capture.
    pub date: Option<String>,
    /// How exactly the stage returns to a position, in millimetres.
    pub repeatability_mm: Option<f64>,
    /// Anything else worth knowing.
    pub notes: Option<String>,
}
