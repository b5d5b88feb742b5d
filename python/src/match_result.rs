//! What matching gives.

use multiscopic::{DisparityMap, Error, Geometry, stereo::confidence_map::ConfidenceMap};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::{arrays, exceptions::exception};

/// Disparities, how sure they are, and the depths that follow from them.
///
/// >>> import numpy as np, multiscopic
/// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
/// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), num_disparities=8)
/// >>> result
/// <multiscopic.Result of 80x60 pixels, 98.8 % of them valid>
/// >>> float(np.nanmedian(result.disparity))
/// 4.0
#[pyclass(name = "Result", module = "multiscopic", frozen)]
pub struct MatchResult {
    map: DisparityMap,
    geometry: Option<Geometry>,
    /// Disparities in pixels: float32 of height x width, NaN where there is none. They are whole multiples of 1/64.
    #[pyo3(get)]
    disparity: Py<PyArray2<f32>>,
    /// The probability that a disparity is at most one pixel off, times 255: uint8 of height x width, 0 where there is none.
    /// None if match() was called with confidence=False.
    #[pyo3(get)]
    confidence: Option<Py<PyArray2<u8>>>,
}

impl MatchResult {
    /// What was matched, and what turns it into depth, if it is known.
    pub fn new(
        py: Python<'_>,
        map: DisparityMap,
        confidences: Option<ConfidenceMap>,
        geometry: Option<Geometry>,
    ) -> PyResult<MatchResult> {
        let disparity = arrays::float_map(py, map.to_float())?.unbind();
        let confidence = confidences.map(|confidences| arrays::map(py, confidences)).transpose()?.map(Bound::unbind);
        Ok(MatchResult { map, geometry, disparity, confidence })
    }
}

#[pymethods]
impl MatchResult {
    /// Depths in metres: float32 of height x width, NaN where there is none.
    ///
    /// The depth of a disparity d is focal_px * baseline_mm / (d + doffs), in millimetres. A rig knows these, and then they
    /// override it.
    ///
    /// Args:
    ///     focal_px: focal length in pixels.
    ///     baseline_mm: distance the camera moved from the centre to each neighbour, in millimetres.
    ///     doffs: negated disparity of a point at infinity, in pixels. The default is the rig's, or 0.
    ///
    /// Raises:
    ///     ValueError: the focal length or the baseline is unknown, or not above 0.
    ///
    /// >>> import numpy as np, multiscopic
    /// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
    /// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), num_disparities=8)
    /// >>> float(np.nanmedian(result.depth(focal_px=500, baseline_mm=40)))
    /// 5.0
    #[pyo3(signature = (focal_px=None, baseline_mm=None, doffs=None))]
    fn depth<'py>(
        &self,
        py: Python<'py>,
        focal_px: Option<f64>,
        baseline_mm: Option<f64>,
        doffs: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let usage = |message: String| exception(Error::Usage(message));
        let known = self.geometry.as_ref();
        let focal_px = focal_px.or(known.map(|geometry| geometry.focal_px));
        let baseline_mm = baseline_mm.or(known.map(|geometry| geometry.baseline_mm));
        let (Some(focal_px), Some(baseline_mm)) = (focal_px, baseline_mm) else {
            let message =
                "depth needs the focal length and the baseline: give focal_px and baseline_mm, or match a rig with them";
            return Err(usage(message.into()));
        };
        for (keyword, length) in [("focal_px", focal_px), ("baseline_mm", baseline_mm)] {
            if !(length > 0.0 && length <= Geometry::MAX_LENGTH) {
                let most = Geometry::MAX_LENGTH;
                return Err(usage(format!("{keyword} is {length}, it must be a number above 0 and at most {most}")));
            }
        }
        let doffs = doffs.or(known.map(|geometry| geometry.doffs)).unwrap_or_default();
        // Depths do not depend on the principal point.
        let geometry = Geometry { focal_px, baseline_mm, principal_point: [0.0; 2], doffs };
        arrays::float_map(py, self.map.to_depth(&geometry))
    }

    fn __repr__(&self) -> String {
        let pixels = self.map.pixels();
        let valid = 100.0 * pixels.iter().flatten().count() as f64 / pixels.len() as f64;
        format!("<multiscopic.Result of {}x{} pixels, {valid:.1} % of them valid>", self.map.width(), self.map.height())
    }
}
