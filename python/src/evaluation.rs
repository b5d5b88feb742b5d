//! Measures of the quality of disparities.

use multiscopic::{DisparityMap, Error, Metrics, Raster, evaluation::Sparsification};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{self, FloatArray},
    interpreter::exception,
};

/// The errors of disparities over all pixels whose true disparity is known.
///
/// A pixel without a disparity counts as bad, and enters the mean errors as a disparity of 0. Disparities are rounded to
/// multiples of 1/64 first, which those of match() are.
///
/// Args:
///     disparity: disparities in pixels, height x width, NaN or +inf where there is none.
///     truth: true disparities in pixels, of the same shape, NaN or +inf where they are unknown.
///     confidence: confidences of the disparities, uint8 of the same shape.
///
/// Returns:
///     rms and avg_err in pixels; bad_0_5, bad_1 and bad_2, the percentages of pixels that are wrong by more than 0.5, 1 and 2
///     pixels; coverage, the share of pixels with a disparity. With confidences also auc, auc_optimal, roc_auc, ece,
///     bad_1_at_90, bad_1_at_80 and bad_1_at_70.
///
/// Raises:
///     ValueError: the shapes differ, or no true disparity is known.
///
/// >>> import numpy as np, multiscopic
/// >>> multiscopic.evaluate(np.array([[3, 3.5], [np.nan, 7]]), np.array([[3, 3], [4, np.nan]]))["avg_err"]
/// 1.5
#[pyfunction]
#[pyo3(signature = (disparity, truth, confidence=None))]
pub fn evaluate<'py>(
    py: Python<'py>,
    disparity: FloatArray<'py>,
    truth: FloatArray<'py>,
    confidence: Option<PyReadonlyArray2<'py, u8>>,
) -> PyResult<Bound<'py, PyDict>> {
    let shape = truth.shape();
    let shapes = [Some(("disparity", disparity.shape())), confidence.as_ref().map(|array| ("confidence", array.shape()))];
    if let Some((name, other)) = shapes.into_iter().flatten().find(|(_, other)| *other != shape) {
        let message = format!("{name} has the shape {other:?}, the truth has {shape:?}");
        return Err(exception(Error::Usage(message)));
    }
    let map = DisparityMap::from_float(&arrays::float_image(&disparity, "disparity")?);
    let truth = arrays::float_image(&truth, "truth")?;
    let unknown = || exception(Error::Usage("no disparity of the truth is known: all are NaN or infinite".into()));
    let Metrics { rms, avg_err, bad_0_5, bad_1, bad_2, coverage } = Metrics::new(&map, &truth).ok_or_else(unknown)?;
    let metrics = PyDict::new(py);
    let errors = [rms, avg_err, bad_0_5, bad_1, bad_2, coverage];
    for (name, value) in ["rms", "avg_err", "bad_0_5", "bad_1", "bad_2", "coverage"].into_iter().zip(errors) {
        metrics.set_item(name, value)?;
    }
    if let Some(confidence) = confidence {
        let confidences = Raster::new(map.width(), map.height(), confidence.as_array().iter().copied().collect());
        let of_confidence = Sparsification::new(&map, &confidences, &truth).ok_or_else(unknown)?.metrics();
        for (name, value) in [
            ("auc", of_confidence.auc),
            ("auc_optimal", of_confidence.auc_optimal),
            ("roc_auc", of_confidence.roc_auc),
            ("ece", of_confidence.ece),
            ("bad_1_at_90", of_confidence.bad_1_at_90),
            ("bad_1_at_80", of_confidence.bad_1_at_80),
            ("bad_1_at_70", of_confidence.bad_1_at_70),
        ] {
            metrics.set_item(name, value)?;
        }
    }
    Ok(metrics)
}
