//! Reading and writing the program's files.

use std::{
    path::PathBuf,
    sync::atomic::{AtomicU64, Ordering},
};

use multiscopic::{DisparityMap, Picture, files::Limits, images::BitDepth};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::{
    arrays::{self, FloatArray, ImageArray},
    interpreter::exception,
};

/// The most pixels of what this process reads, as Python has set them.
static MAX_PIXELS: AtomicU64 = AtomicU64::new(Limits::DEFAULT.max_pixels);

/// The limits of what this process reads.
pub fn limits() -> Limits {
    Limits { max_pixels: MAX_PIXELS.load(Ordering::Relaxed) }
}

/// Reads an image as the program does: PNG, JPEG, TIFF, BMP, WebP, PGM, PPM or PFM, turned as its EXIF orientation says, in 8
/// bits.
///
/// Args:
///     path: the file.
///
/// Returns:
///     uint8 of height x width, or height x width x 3 (RGB) if the image is in colour.
///
/// Raises:
///     OSError: the file cannot be read.
///     ValueError: it is not an image.
#[pyfunction]
pub fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    arrays::image_array(py, py.detach(|| Picture::read_within(&path, None, limits())).map_err(exception)?.into_8_bits())
}

/// Changes the most pixels of the images and maps that are read, 67,108,864 at first. Files that claim more are refused before
/// memory is taken for them. No side may have more than 65,535 pixels.
///
/// Args:
///     pixels: the most pixels.
#[pyfunction]
pub fn set_max_pixels(pixels: u64) {
    MAX_PIXELS.store(pixels, Ordering::Relaxed);
}

/// Writes an image as PNG. Any previous version of the file is replaced as a whole.
///
/// Args:
///     path: the file.
///     image: uint8 or uint16 of height x width, or height x width x 3 (RGB).
///
/// Raises:
///     OSError: the file cannot be written.
///     ValueError: the shape is another one.
#[pyfunction]
pub fn write_png(py: Python<'_>, path: PathBuf, image: ImageArray<'_>) -> PyResult<()> {
    // All values of 16 bits, which leaves them as they are.
    let picture = arrays::picture(&image, "image", BitDepth::Sixteen)?;
    py.detach(|| picture.write_png(&path)).map_err(exception)
}

/// Reads a PFM file with one channel: disparities in pixels or depths in metres.
///
/// Args:
///     path: the file.
///
/// Returns:
///     float32 of height x width, NaN where the file has +inf, which is how PFM files mark pixels without a value.
///
/// Raises:
///     OSError: the file cannot be read.
///     ValueError: it is not a PFM file, or is damaged.
#[pyfunction]
pub fn read_pfm(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray2<f32>>> {
    arrays::float_map(py, py.detach(|| multiscopic::files::read_pfm_within(&path, limits())).map_err(exception)?)
}

/// Writes a PFM file with one channel. Any previous version of the file is replaced as a whole.
///
/// Args:
///     path: the file.
///     values: numbers of height x width. NaN becomes +inf.
///
/// Raises:
///     OSError: the file cannot be written.
///
/// >>> import numpy as np, pathlib, tempfile, multiscopic
/// >>> path = pathlib.Path(tempfile.mkdtemp()) / "disparity.pfm"
/// >>> multiscopic.write_pfm(path, np.array([[1.5, np.nan]]))
/// >>> multiscopic.read_pfm(path)
/// array([[1.5, nan]], dtype=float32)
#[pyfunction]
pub fn write_pfm(py: Python<'_>, path: PathBuf, values: FloatArray<'_>) -> PyResult<()> {
    let image = arrays::float_image(&values, "values")?;
    py.detach(|| multiscopic::files::write_pfm(&image, &path)).map_err(exception)
}

/// Disparities in colour, as the program draws them: near is red, far is blue, and pixels without a disparity are black.
///
/// Args:
///     disparity: disparities in pixels, height x width, NaN where there is none.
///     range: the disparities of blue and of red. The default is the smallest and the largest one.
///
/// Returns:
///     uint8 of height x width x 3 (RGB).
///
/// >>> import numpy as np, multiscopic
/// >>> multiscopic.colorize(np.array([[1.0, np.nan, 9.0]])).shape
/// (1, 3, 3)
#[pyfunction]
#[pyo3(signature = (disparity, range=None))]
pub fn colorize<'py>(
    py: Python<'py>,
    disparity: FloatArray<'py>,
    range: Option<(f32, f32)>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let map = DisparityMap::from_float(&arrays::float_image(&disparity, "disparity")?);
    arrays::color_image(py, multiscopic::images::turbo(&map, range.map(|(far, near)| far..=near)))
}
