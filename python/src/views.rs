//! Matching, rectification and inspection of arrays.

use std::ffi::{CStr, CString};

use multiscopic::{Frames, Geometry, Inspection, MatchSetup, RangeSource};
use multiscopic_options::keywords::{self, Keyword};
use pyo3::{
    prelude::*,
    types::{PyCFunction, PyDict},
};

use crate::{
    arrays::{self, Bits, ImageArray},
    capture::{Capture, ViewArrays, frame_offset},
    interpreter,
    match_result::MatchResult,
    options::Options,
};

/// The smallest disparity and the number of disparities.
type DisparityRange = (i16, u16);

/// Estimates the disparity of each pixel of a centre image by matching it with its neighbours.
///
/// Images are uint8 or uint16 of height x width, or height x width x 3 (RGB), all of the same size. Each is named by where the
/// camera was moved to: the match of centre pixel (u, v) at disparity d is at (u - d, v) in the right view, (u + d, v) in the
/// left, (u, v + d) in the top and (u, v - d) in the bottom view. The right image of a stereo pair whose left image is the
/// centre is the right view. Other threads run meanwhile, and Ctrl-C ends all methods but block matching.
///
/// Args:
///     center: the reference image.
///     left, right, top, bottom: images taken with the camera moved by one baseline. At least one is needed.
///     views: images taken elsewhere, by their offsets in baselines to the right and down, such as {(1, -1): image}.
///     OPTIONS
///
/// Returns:
///     A Result with the disparities and their confidences. The bits are those of `multiscopic match` with the same options.
///
/// Raises:
///     TypeError: an image is neither uint8 nor uint16, or there is no such argument.
///     ValueError: images differ in size, an argument is out of range, or arguments do not go together.
///     OSError: the weights of MC-CNN cannot be read.
///
/// >>> import numpy as np, multiscopic
/// >>> center = np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8)
/// >>> left, right = np.roll(center, 4, axis=1), np.roll(center, -4, axis=1)
/// >>> result = multiscopic.match(center, left, right, method="bm", num_disparities=8, block_size=7)
/// >>> result.disparity.dtype, result.disparity.shape, result.confidence.dtype
/// (dtype('float32'), (60, 80), dtype('uint8'))
/// >>> float(np.nanmedian(result.disparity))
/// 4.0
#[pyfunction]
#[pyo3(
    name = "match",
    signature = (center, left=None, right=None, top=None, bottom=None, *, views=None, **options)
)]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
fn matched<'py>(
    py: Python<'py>,
    center: ImageArray<'py>,
    left: Option<ImageArray<'py>>,
    right: Option<ImageArray<'py>>,
    top: Option<ImageArray<'py>>,
    bottom: Option<ImageArray<'py>>,
    views: Option<ViewArrays<'py>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<MatchResult> {
    let options = Options::new(options)?;
    let named = [left.as_ref(), right.as_ref(), top.as_ref(), bottom.as_ref()];
    Capture::of_arrays(&center, named, &views.unwrap_or_default(), options.bits())?.matched(py, &options)
}

/// Estimates the disparity of each pixel of a centre image from the frames of a camera that slid along its rows: a sweep.
///
/// A filter refines the disparities with one frame after the other, and the network matches two of them beside it. The disparities
/// are those at the baseline.
///
/// Args:
///     center: the reference image, as match() takes it.
///     frames: the other images, at least two, all of the same size.
///     offsets_mm: where each was taken, in millimetres to the right of the centre; negative to the left.
///     baseline_mm: the unit of disparities. The default is the distance of the farthest frame. One frame must be within 5 % of it.
///     options: min_disparity, num_disparities, min_confidence, auto_range, inspection, bits, threads, simd and max_memory, as
///         match() takes them. There are at most 256 disparities.
///
/// Returns:
///     A Result with the disparities and their confidences. The bits are those of `multiscopic match` of a folder of the frames.
///
/// Raises:
///     TypeError: an image is neither uint8 nor uint16, or there is no such argument.
///     ValueError: images differ in size, an argument is out of range, or it has no effect on a sweep.
///
/// >>> import numpy as np, multiscopic
/// >>> u, v = np.meshgrid(np.arange(64), np.arange(48))
/// >>> picture = lambda b: (128 + 50 * np.sin(0.8 * (u + 4 * b) + v) + 40 * np.cos(0.3 * (u + 4 * b) - 0.6 * v)).astype(np.uint8)
/// >>> offsets = [5, -5, 10, -10, 15, -15, 20, -20]
/// >>> frames = [picture(offset / 20) for offset in offsets]
/// >>> result = multiscopic.match_sweep(picture(0), frames, offsets, min_disparity=0, num_disparities=12)
/// >>> round(float(np.nanmedian(result.disparity)), 1)
/// 4.0
#[pyfunction]
#[pyo3(signature = (center, frames, offsets_mm, *, baseline_mm=None, **options))]
pub fn match_sweep<'py>(
    py: Python<'py>,
    center: ImageArray<'py>,
    frames: Vec<ImageArray<'py>>,
    offsets_mm: Vec<f64>,
    baseline_mm: Option<f64>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<MatchResult> {
    let options = Options::new(options)?;
    Capture::of_sweep(&center, &frames, &offsets_mm, baseline_mm, options.bits())?.matched(py, &options)
}

/// Adds `match` to the module, with a signature and a documentation that list the keyword arguments by their descriptions.
pub fn add_match(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let function = wrap_pyfunction!(matched, module)?;
    let keywords = Keyword::all();
    let text: String = function.getattr("__doc__")?.extract()?;
    let text = text.replace("    OPTIONS\n", &keywords::documentation(&keywords));
    // Python reads signatures from the first line.
    let images = "center, left=None, right=None, top=None, bottom=None, *, views=None";
    let text = format!("match({images}, {})\n--\n\n{text}", keywords::signature(&keywords));
    let text: &'static CStr = Box::leak(CString::new(text)?.into_boxed_c_str());
    let function = function.unbind();
    let documented = PyCFunction::new_closure(module.py(), Some(c"match"), Some(text), move |images, options| {
        function.call(images.py(), images, options)
    })?;
    documented.setattr("__module__", module.name()?)?;
    module.add("match", documented)
}

/// Rectifies views: finds from the images how each is turned, scaled and off its place, and takes that out.
///
/// Args:
///     center, left, right, top, bottom, views: images, as match() takes them.
///     min_disparity, num_disparities: range of the disparities that are looked for, in pixels. The defaults are 1 and 60.
///     focal_px: focal length in pixels. Large rotations are found more precisely with it.
///     bits: bits of the values in uint16, as match() takes them.
///
/// Returns:
///     The rectified images by their offsets in baselines to the right and down. The centre's is (0, 0). Those of uint16 are
///     uint16, in which white is 65535.
///
/// Raises:
///     TypeError: an image is neither uint8 nor uint16.
///     ValueError: images differ in size, or a view has too little in common with the centre.
#[pyfunction]
#[pyo3(
    signature = (
        center, left=None, right=None, top=None, bottom=None,
        *, views=None, min_disparity=None, num_disparities=None, focal_px=None, bits=None
    )
)]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn align<'py>(
    py: Python<'py>,
    center: ImageArray<'py>,
    left: Option<ImageArray<'py>>,
    right: Option<ImageArray<'py>>,
    top: Option<ImageArray<'py>>,
    bottom: Option<ImageArray<'py>>,
    views: Option<ViewArrays<'py>>,
    min_disparity: Option<i16>,
    num_disparities: Option<u16>,
    focal_px: Option<f64>,
    bits: Option<Bits>,
) -> PyResult<Bound<'py, PyDict>> {
    let named = [left.as_ref(), right.as_ref(), top.as_ref(), bottom.as_ref()];
    let capture = Capture::of_arrays(&center, named, &views.unwrap_or_default(), bits.map(|Bits(depth)| depth))?;
    let rectified = interpreter::run(py, |_| {
        let mut frames = capture.frames();
        let [width, height] = frames.size().map(|side| side as f64);
        let principal_point = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
        // The baseline does not matter to the images.
        let mut geometry = focal_px.map(|focal_px| Geometry { focal_px, baseline_mm: 1.0, principal_point, doffs: 0.0 });
        let unaligned = frames.clone().without_color();
        let options = Options::of_range(min_disparity, num_disparities)?;
        let mut rectified = Vec::new();
        MatchSetup::rectifying(
            &mut frames,
            &mut geometry,
            None,
            RangeSource::Paper,
            |range| options.search(&unaligned, range),
            |alignment| {
                rectified = capture.ideal(Some(alignment)).collect();
                Ok(Frames::of_pictures(rectified.clone()).expect("the centre is among them"))
            },
        )?;
        Ok(rectified)
    })?;
    let arrays = PyDict::new(py);
    for (frame, picture) in rectified {
        arrays.set_item(frame_offset(frame), arrays::image_array(py, picture)?)?;
    }
    Ok(arrays)
}

/// Tells what images show before they are matched: the range of their disparities, and what may be wrong with them.
///
/// Args:
///     center, left, right, top, bottom, views: images, as match() takes them.
///     bits: bits of the values in uint16, as match() takes them.
///
/// Returns:
///     The range, (min_disparity, num_disparities), or None if the images do not show it; and warnings about views that look
///     swapped, images that are blurred, and the like.
///
/// Raises:
///     TypeError: an image is neither uint8 nor uint16.
///     ValueError: images differ in size.
#[pyfunction]
#[pyo3(signature = (center, left=None, right=None, top=None, bottom=None, *, views=None, bits=None))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn inspect<'py>(
    py: Python<'py>,
    center: ImageArray<'py>,
    left: Option<ImageArray<'py>>,
    right: Option<ImageArray<'py>>,
    top: Option<ImageArray<'py>>,
    bottom: Option<ImageArray<'py>>,
    views: Option<ViewArrays<'py>>,
    bits: Option<Bits>,
) -> PyResult<(Option<DisparityRange>, Vec<String>)> {
    let named = [left.as_ref(), right.as_ref(), top.as_ref(), bottom.as_ref()];
    let capture = Capture::of_arrays(&center, named, &views.unwrap_or_default(), bits.map(|Bits(depth)| depth))?;
    interpreter::run(py, |_| {
        let inspection = Inspection::of(&capture.frames());
        Ok((inspection.found_range().ok(), inspection.warnings(0).iter().map(ToString::to_string).collect()))
    })
}
