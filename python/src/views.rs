//! Matching, rectification and inspection of arrays.

use multiscopic::{Frames, Geometry, Inspection, Method, Preparation};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{self, Bits, ImageArray},
    capture::{Capture, ViewArrays},
    interruption,
    match_result::MatchResult,
    options::Options,
    rig::frame_offset,
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
///     method: "bm", block matching; "gc", graph cuts; "sgm", semi-global matching; "mccnn-fast" and "mccnn-accurate", whose
///         weights `multiscopic weights install` installs; "net", a small network.
///     fusion: "min", "mean", "heuristic" or "half" of the views' costs. The default is "min" with one or two views,
///         "heuristic" with three or four, "half" with more.
///     min_disparity: smallest disparity in pixels, may be negative (OpenCV: minDisparity). The default is 1.
///     num_disparities: number of disparities searched, not only multiples of 16 (OpenCV: numDisparities). The default is 60.
///     block_size: side of the block in pixels, odd, from 1 to 21 (OpenCV: blockSize). The default is 11, and 5 for the cost
///         "sad".
///     auto_range: find the range of disparities from the images.
///     align: rectify the views first.
///     bits: bits of the values in uint16, or in a rig's files of 16 bits: 10, 12, 14 or 16. White is the largest number of so
///         many bits. The default is that of rig.toml, or the least that have the brightest sample of all images.
///     cost: cost of "sgm": "census", "census2" or "sad".
///     census: window of the census transform: "5x5", "7x7" or "9x7".
///     p1, p2: penalties of "sgm" for disparity changes of one and for larger ones, up to 51 (OpenCV: P1, P2).
///     p2_edge: difference of brightness above which p2 is lowered. 255 turns this off.
///     paths: number of paths of "sgm": 4, 5 or 8.
///     occlusion_cost: cost of an occlusion in "gc" in grey levels, or "auto" to estimate it. The default is 10.
///     occlusions: what "gc" makes of pixels without a match: "unique" leaves them invalid, and no two pixels share a match;
///         "capped" gives them the disparity of their surroundings. The default is "unique" with one view, "capped" with more.
///     smoothness: penalty of "gc" between neighbours: "linear" in the step of disparity, or "potts", the same for every step.
///     lambda1, lambda2: penalties of "gc" for a disparity step of one between neighbours of similar and of different brightness,
///         in grey levels.
///     theta: difference of brightness from which "gc" takes neighbours for different, from 0 to 255. The default is 8.
///     cutoff: step of disparity in pixels above which the penalty of "gc" stops growing. The default is 5.
///     gray: let "gc" match grey values even if the images are in colour.
///     sweeps: maximum number of sweeps of "gc". The default is 20.
///     seed: seed of the order in which "gc" tries disparities.
///     refine: whether "gc" refines disparities to fractions of a pixel.
///     keep_occluded: let "gc" leave occluded pixels invalid instead of filling them from the background.
///     upsample: factor by which "gc" enlarges the images, from 1 to 4, for finer disparities.
///     sgm_p1, sgm_p2: penalties of MC-CNN for disparity changes of one and for larger ones. The defaults are 2.3 and 55.9 for
///         "mccnn-fast", 1.3 and 18.1 for "mccnn-accurate".
///     sgm_q1, sgm_q2: divisors of both penalties at an edge in one image and in both. The defaults are 4 and 8, 4.5 and 9.
///     sgm_v: further divisor of the first penalty on vertical paths. The default is 1.5, 2.75.
///     sgm_d: difference of brightness that makes an edge, in standard deviations of the image. The default is 0.08, 0.13.
///     cbca_intensity: average the costs of MC-CNN over a cross of pixels that differ in brightness by less than this, in
///         standard deviations of the image.
///     cbca_distance: limit the arms of that cross to less than so many pixels.
///     cbca_iterations_1, cbca_iterations_2: number of averaging passes before and after the paths. The defaults are 0 and 0 for
///         "mccnn-fast", 2 and 0 for "mccnn-accurate".
///     uniqueness_ratio: keep a disparity only if every candidate more than a pixel away costs over so many percent more; not for
///         "gc" and "net" (OpenCV: uniquenessRatio).
///     disp12_max_diff: keep a disparity only if a view confirms it to within so many pixels; not for "gc" and "net" (OpenCV:
///         disp12MaxDiff).
///     texture_threshold: keep a disparity only where there is so much texture (OpenCV: textureThreshold).
///     speckle_window_size: remove patches of up to so many pixels that stand alone (OpenCV: speckleWindowSize).
///     speckle_range: by how many pixels neighbouring disparities of a patch may differ (OpenCV: speckleRange). The default is 1.
///     median: side of the window of a median filter, odd, from 3 to 31.
///     bilateral: bilateral filter: standard deviation of its Gaussian in pixels, and greatest difference of disparities.
///     sub_pixel: "lucas-kanade" sharpens disparities by up to half a pixel, "none" does not. The default of "net" is
///         "lucas-kanade".
///     repair: "smooth" replaces what is more probably wrong than right by what is sure around it, and moves others by up to
///         half a pixel; "none" does not. The default of "net" is "smooth".
///     min_confidence: keep a disparity only if it is at most one pixel off with this probability, from 0 to 1.
///     smooth: smooth disparities within the edges of the centre, so that all pixels get one.
///     fill: "background" fills pixels without a disparity, after all other filters.
///     prior: disparities around which all views are searched instead of over the whole range: numbers of height x width in
///         pixels of one baseline, NaN or infinite where unknown. They are rounded to multiples of 1/64, which those of match()
///         are. Of the filters, sub_pixel alone goes with it, and there are no confidences.
///     prior_disparities: number of disparities that views at longer baselines search around those found at the shortest one, or
///         all views around the prior, in pixels of the longer baseline.
///     prior_median: side of the median filter of what is searched around, odd, from 3 to 31, or 0 for none.
///     together: match all views together over the whole range, whatever their baselines.
///     confidence: whether the result has confidences, which take time. The default is True, and False with a prior.
///     threads: number of threads. 0, the default, is one for each core.
///     simd: vector instructions by the program's name for them. They do not change the result.
///     max_memory: refuse to match or to align if that takes more than so many megabytes. The default is
///         what is available.
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
/// >>> result = multiscopic.match(center, left, right, num_disparities=8, block_size=7)
/// >>> result.disparity.dtype, result.disparity.shape, result.confidence.dtype
/// (dtype('float32'), (60, 80), dtype('uint8'))
/// >>> float(np.nanmedian(result.disparity))
/// 4.0
#[pyfunction]
#[pyo3(
    name = "match",
    signature = (center, left=None, right=None, top=None, bottom=None, *, views=None, **options),
    text_signature = "(center, left=None, right=None, top=None, bottom=None, *, views=None, method='bm', fusion=None, \
                      min_disparity=None, num_disparities=None, block_size=None, auto_range=False, align=False, bits=None, \
                      cost='census', census='9x7', p1=None, p2=None, p2_edge=None, paths=5, occlusion_cost=None, \
                      occlusions=None, smoothness='linear', lambda1=None, lambda2=None, theta=8, cutoff=5, gray=False, \
                      sweeps=20, seed=0, refine=True, keep_occluded=False, upsample=1, sgm_p1=None, sgm_p2=None, sgm_q1=None, \
                      sgm_q2=None, sgm_v=None, sgm_d=None, cbca_intensity=0.02, cbca_distance=14, cbca_iterations_1=None, \
                      cbca_iterations_2=None, uniqueness_ratio=None, disp12_max_diff=None, texture_threshold=None, \
                      speckle_window_size=None, speckle_range=None, median=None, bilateral=None, sub_pixel=None, \
                      repair=None, min_confidence=None, smooth=False, fill=None, prior=None, prior_disparities=8, \
                      prior_median=21, together=False, confidence=None, threads=0, simd=None, max_memory=None)"
)]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn matched<'py>(
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
    let rectified = interruption::run(py, |_| {
        let mut frames = capture.frames();
        let [width, height] = frames.size().map(|side| side as f64);
        let principal_point = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
        // The baseline does not matter to the images.
        let mut geometry = focal_px.map(|focal_px| Geometry { focal_px, baseline_mm: 1.0, principal_point, doffs: 0.0 });
        let unaligned = frames.clone().without_color();
        let options = Options::of_range(min_disparity, num_disparities);
        let mut rectified = Vec::new();
        Preparation::rectifying(
            &mut frames,
            &mut geometry,
            false,
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
    interruption::run(py, |_| {
        let inspection = Inspection::of(&capture.frames());
        Ok((
            inspection.found_range().ok(),
            inspection.warnings(Method::DEFAULT_RANGE.0).iter().map(ToString::to_string).collect(),
        ))
    })
}
