//! The result of matching, and measures of its quality.

use std::path::PathBuf;

use multiscopic::{
    DisparityMap, Error, FloatImage, Geometry, Metrics, Picture, Raster,
    evaluation::Sparsification,
    files::{
        Cloud,
        ply::{self, Encoding},
    },
    images::{Edges, FrameTree, PointFrame},
    stereo::confidence_map::ConfidenceMap,
};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{self, FloatArray},
    interpreter::exception,
};

/// Disparities, how sure they are, and the depths that follow from them.
///
/// >>> import numpy as np, multiscopic
/// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
/// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), method="bm", num_disparities=8)
/// >>> result
/// <multiscopic.Result of 80x60 pixels, 98.8 % of them valid>
/// >>> float(np.nanmedian(result.disparity))
/// 4.0
#[pyclass(name = "Result", module = "multiscopic", frozen)]
pub struct MatchResult {
    map: DisparityMap,
    confidences: Option<ConfidenceMap>,
    /// The standard deviations of the disparities in pixels, if they are known.
    deviations: Option<FloatImage>,
    /// The centre as it was matched, in 8 bits.
    center: Picture,
    camera: KnownCamera,
    /// Disparities in pixels: float32 of height x width, NaN where there is none. They are whole multiples of 1/64.
    #[pyo3(get)]
    disparity: Py<PyArray2<f32>>,
    /// The probability that a disparity is at most one pixel off, times 255: uint8 of height x width, 0 where there is none.
    /// None if match() was called with confidence=False or with a prior.
    #[pyo3(get)]
    confidence: Option<Py<PyArray2<u8>>>,
    /// The reasons to doubt the images or the disparities, the worst first: sentences that say what mends them.
    #[pyo3(get)]
    warnings: Vec<String>,
}

impl MatchResult {
    /// Makes the result of a match of `center` by a camera of which so much is known.
    pub fn new(
        py: Python<'_>,
        (map, confidences, deviations): (DisparityMap, Option<ConfidenceMap>, Option<FloatImage>),
        center: Picture,
        camera: KnownCamera,
        warnings: Vec<String>,
    ) -> PyResult<MatchResult> {
        let disparity = arrays::float_map(py, map.to_float())?.unbind();
        let confidence = confidences.clone().map(|confidences| arrays::map(py, confidences)).transpose()?.map(Bound::unbind);
        Ok(MatchResult { map, confidences, deviations, center: center.into_8_bits(), camera, disparity, confidence, warnings })
    }

    /// Returns the geometry that turns disparities into depth: these numbers, or else what is known of the camera.
    fn geometry(
        &self,
        focal_px: Option<f64>,
        baseline_mm: Option<f64>,
        doffs: Option<f64>,
        principal_point: Option<[f64; 2]>,
    ) -> PyResult<Geometry> {
        let usage = |message: String| exception(Error::Usage(message));
        let camera = KnownCamera {
            focal_px: focal_px.or(self.camera.focal_px),
            baseline_mm: baseline_mm.or(self.camera.baseline_mm),
            principal_point: principal_point.unwrap_or(self.camera.principal_point),
            doffs: doffs.unwrap_or(self.camera.doffs),
            ..self.camera
        };
        let Some(geometry) = camera.geometry() else {
            let message =
                "depth needs the focal length and the baseline: give focal_px and baseline_mm, or match a rig with them";
            return Err(usage(message.into()));
        };
        check_length("focal_px", geometry.focal_px)?;
        check_length("baseline_mm", geometry.baseline_mm)?;
        let [cx, cy] = geometry.principal_point;
        for (keyword, number) in [("doffs", geometry.doffs), ("principal_point", cx), ("principal_point", cy)] {
            if !number.is_finite() {
                return Err(usage(format!("{keyword} is {number}, it must be a number")));
            }
        }
        Ok(geometry)
    }

    /// The standard deviations of the depths in metres, if those of the disparities are known.
    fn depth_deviations(&self, geometry: &Geometry) -> Option<FloatImage> {
        Some(geometry.depth_deviations(&self.map, self.deviations.as_ref()?, self.camera.baseline_deviation_mm))
    }

    /// The cloud in a frame, without confidences and deviations.
    fn cloud<'a>(&'a self, geometry: &'a Geometry, frame: &str, edges: &str) -> PyResult<Cloud<'a>> {
        let unknown = |keyword: &str, found: &str, expected: &str| {
            exception(Error::Usage(format!("{keyword} is {found:.40}, it must be {expected}")))
        };
        let frames = [PointFrame::Camera, PointFrame::Tool, PointFrame::Base];
        let named = frames.into_iter().find(|known| known.name() == frame);
        let frame = named.ok_or_else(|| unknown("frame", frame, "camera, tool or base"))?;
        let edges = match edges {
            "drop" => Edges::Drop,
            "keep" => Edges::Keep,
            _ => return Err(unknown("edges", edges, "drop or keep")),
        };
        let cloud = Cloud { frame, edges, frames: self.camera.frames, ..Cloud::new(&self.map, &self.center, geometry) };
        cloud.check().map_err(exception)?;
        Ok(cloud)
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
    /// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), method="bm", num_disparities=8)
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
        let geometry = self.geometry(focal_px, baseline_mm, doffs, None)?;
        arrays::float_map(py, geometry.depths(&self.map))
    }

    /// Standard deviations of the depths in metres: float32 of height x width, NaN where there is none. The truth is within two
    /// of them in 95 % of the pixels.
    ///
    /// Args:
    ///     focal_px, baseline_mm, doffs: as depth() takes them.
    ///
    /// Raises:
    ///     ValueError: the focal length or the baseline is unknown, or not above 0; or match() was called with confidence=False,
    ///         with a prior, or with a method whose deviations are unknown.
    ///
    /// >>> import numpy as np, multiscopic
    /// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
    /// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), method="bm", num_disparities=8)
    /// >>> sigma = result.sigma(focal_px=500, baseline_mm=40)
    /// >>> precise = result.depth(focal_px=500, baseline_mm=40)[sigma < 1]
    #[pyo3(signature = (focal_px=None, baseline_mm=None, doffs=None))]
    fn sigma<'py>(
        &self,
        py: Python<'py>,
        focal_px: Option<f64>,
        baseline_mm: Option<f64>,
        doffs: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let geometry = self.geometry(focal_px, baseline_mm, doffs, None)?;
        let unknown = "the deviations are unknown: match with confidences, without a prior, and by net, bm, sgm or gc";
        let deviations = self.depth_deviations(&geometry).ok_or_else(|| exception(Error::Usage(unknown.into())))?;
        arrays::float_map(py, deviations)
    }

    /// Points in metres: float32 of height x width x 3, NaN where there is none: x to the right, y down, z away from the camera, or
    /// in the frame of an arm.
    ///
    /// `points[np.isfinite(points[..., 2])]` is the cloud, as Open3D and others take it.
    ///
    /// Args:
    ///     focal_px, baseline_mm, doffs: as depth() takes them.
    ///     principal_point: where the optical axis meets the image, (x, y) in pixels from the centre of the top left pixel. The
    ///         default is the rig's, or the middle of the image.
    ///     frame: "camera", "tool" or "base": the frame of coordinates. The others than the camera's need a rig that an arm took
    ///         with a hand-eye calibration.
    ///     edges: "drop" or "keep": points between two surfaces, which fly behind the nearer one.
    ///
    /// Raises:
    ///     ValueError: the focal length or the baseline is unknown, or not above 0; or it is not known where the frame is.
    ///
    /// >>> import numpy as np, multiscopic
    /// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
    /// >>> result = multiscopic.match(center, right=np.roll(center, -4, axis=1), method="bm", num_disparities=8)
    /// >>> points = result.points(focal_px=500, baseline_mm=40, principal_point=(30, 20))
    /// >>> points.shape, [round(float(metres), 3) for metres in points[30, 40]]
    /// ((60, 80, 3), [0.1, 0.1, 5.0])
    #[pyo3(signature = (focal_px=None, baseline_mm=None, doffs=None, principal_point=None, frame="camera", edges="drop"))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn points<'py>(
        &self,
        py: Python<'py>,
        focal_px: Option<f64>,
        baseline_mm: Option<f64>,
        doffs: Option<f64>,
        principal_point: Option<[f64; 2]>,
        frame: &str,
        edges: &str,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let geometry = self.geometry(focal_px, baseline_mm, doffs, principal_point)?;
        let cloud = self.cloud(&geometry, frame, edges)?;
        let points = cloud.pixels().flat_map(|point| point.map_or([f32::NAN; 3], |point| point.metres)).collect();
        arrays::in_shape(py, points, [self.map.height(), self.map.width(), 3])
    }

    /// Writes a point cloud in metres as PLY, in the colours of the centre, and with confidences and sigmas if there are some. Any
    /// previous version of the file is replaced as a whole.
    ///
    /// Args:
    ///     path: the file.
    ///     focal_px, baseline_mm, doffs: as depth() takes them.
    ///     principal_point: where the optical axis meets the image, (x, y) in pixels from the centre of the top left pixel. The
    ///         default is the rig's, or the middle of the image.
    ///     ascii: write text instead of binary numbers.
    ///     frame, edges: as points() takes them.
    ///
    /// Raises:
    ///     OSError: the file cannot be written.
    ///     ValueError: the focal length or the baseline is unknown, or not above 0.
    #[pyo3(signature = (path, focal_px=None, baseline_mm=None, doffs=None, principal_point=None, ascii=false, frame="camera", edges="drop"))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn write_ply(
        &self,
        py: Python<'_>,
        path: PathBuf,
        focal_px: Option<f64>,
        baseline_mm: Option<f64>,
        doffs: Option<f64>,
        principal_point: Option<[f64; 2]>,
        ascii: bool,
        frame: &str,
        edges: &str,
    ) -> PyResult<()> {
        let geometry = self.geometry(focal_px, baseline_mm, doffs, principal_point)?;
        let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
        let deviations = self.depth_deviations(&geometry);
        let (confidences, deviations) = (self.confidences.as_ref(), deviations.as_ref());
        let cloud = Cloud { confidences, deviations, ..self.cloud(&geometry, frame, edges)? };
        py.detach(|| ply::write(&path, &cloud, encoding)).map_err(exception)
    }

    fn __repr__(&self) -> String {
        let pixels = self.map.pixels();
        let valid = 100.0 * pixels.iter().flatten().count() as f64 / pixels.len() as f64;
        format!("<multiscopic.Result of {}x{} pixels, {valid:.1} % of them valid>", self.map.width(), self.map.height())
    }
}

/// The geometry that turns disparities into depth, as far as it is known.
#[derive(Clone, Copy, Debug)]
pub struct KnownCamera {
    /// Focal length in pixels.
    pub focal_px: Option<f64>,
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: Option<f64>,
    /// The point where the optical axis meets the images that are matched, in pixels.
    pub principal_point: [f64; 2],
    /// The negated disparity of a point at infinity, in pixels.
    pub doffs: f64,
    /// The standard deviation of the baseline in millimetres.
    pub baseline_deviation_mm: f64,
    /// The frames of coordinates of an arm, as far as they are known.
    pub frames: FrameTree,
}

impl KnownCamera {
    /// A camera of which nothing is known, whose images have `width` x `height` pixels.
    pub fn unknown((width, height): (u32, u32)) -> KnownCamera {
        let principal_point = [width, height].map(|side| (f64::from(side) - 1.0) / 2.0);
        KnownCamera {
            focal_px: None,
            baseline_mm: None,
            principal_point,
            doffs: 0.0,
            baseline_deviation_mm: 0.0,
            frames: FrameTree::default(),
        }
    }

    /// The geometry, if all of it is known.
    pub fn geometry(&self) -> Option<Geometry> {
        let KnownCamera { focal_px, baseline_mm, principal_point, doffs, .. } = *self;
        Some(Geometry { focal_px: focal_px?, baseline_mm: baseline_mm?, principal_point, doffs })
    }
}

/// Refuses a keyword that is no length, in pixels or millimetres.
pub fn check_length(keyword: &str, length: f64) -> PyResult<()> {
    let most = Geometry::MAX_LENGTH;
    if length > 0.0 && length <= most {
        return Ok(());
    }
    Err(exception(Error::Usage(format!("{keyword} is {length}, it must be a number above 0 and at most {most}"))))
}

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
