//! What was wrong with images before they were rectified.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::residual::Residual;

/// The `[alignment]` of a `rig.toml` whose images are rectified: what was wrong with the original ones. It tells people, and
/// changes nothing about matching.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlignmentRecord {
    /// The rotation between the camera and the axes along which the views stand, about the axes to the right, down and ahead, in
    /// degrees.
    pub common_rotation_deg: [f64; 3],
    /// Its standard deviations; NaN for an angle that the views do not determine, as that about a single baseline.
    pub common_rotation_deviation_deg: [f64; 3],
    /// The misalignment of each view, by its name.
    pub views: BTreeMap<String, Residual>,
}
