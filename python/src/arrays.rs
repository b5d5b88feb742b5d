//! Numpy arrays as pictures and maps, and back.

use image::{ImageBuffer, RgbImage};
use multiscopic::{Error, FloatImage, Picture, Raster};
use numpy::{AllowTypeChange, Element, IntoPyArray, PyArray2, PyArray3, PyArrayLike2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::exceptions::exception;

/// An image as it comes from Python: uint8, of height x width or height x width x 3 (RGB), in any order of memory.
pub type ImageArray<'py> = PyReadonlyArrayDyn<'py, u8>;

/// Numbers of height x width, which become float32.
pub type FloatArray<'py> = PyArrayLike2<'py, f32, AllowTypeChange>;

/// A copy of an image, which `name` stands for in errors.
pub fn picture(array: &ImageArray<'_>, name: &str) -> PyResult<Picture> {
    // The slice of numpy's crate would be in the order of memory, which need not be that of rows.
    let samples = match array.as_array().as_slice() {
        Some(samples) => samples.to_vec(),
        None => array.as_array().iter().copied().collect(),
    };
    let picture = match *array.shape() {
        [height, width] if height > 0 && width > 0 => {
            ImageBuffer::from_raw(width as u32, height as u32, samples).map(Picture::Gray)
        }
        [height, width, 3] if height > 0 && width > 0 => {
            ImageBuffer::from_raw(width as u32, height as u32, samples).map(Picture::Rgb)
        }
        _ => None,
    };
    picture.ok_or_else(|| {
        let message = format!("{name} has the shape {:?}, it must be (height, width) or (height, width, 3)", array.shape());
        exception(Error::Usage(message))
    })
}

/// A copy of numbers, of which +inf and NaN both mean that there is none. `name` stands for them in errors.
pub fn float_image(array: &FloatArray<'_>, name: &str) -> PyResult<FloatImage> {
    match *array.shape() {
        [height, width] if height > 0 && width > 0 => {
            let pixels = array.as_array().iter().map(|&pixel| if pixel.is_nan() { f32::INFINITY } else { pixel }).collect();
            Ok(FloatImage::new(width, height, pixels))
        }
        _ => Err(exception(Error::Usage(format!("{name} is empty")))),
    }
}

/// An array of height x width, without a copy.
pub fn map<T: Element>(py: Python<'_>, raster: Raster<T>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let shape = [raster.height(), raster.width()];
    numpy::PyArrayMethods::reshape(&raster.into_pixels().into_pyarray(py), shape)
}

/// An array of height x width with NaN where there is no number.
pub fn float_map(py: Python<'_>, mut image: FloatImage) -> PyResult<Bound<'_, PyArray2<f32>>> {
    for pixel in image.pixels_mut().iter_mut().filter(|pixel| !pixel.is_finite()) {
        *pixel = f32::NAN;
    }
    map(py, image)
}

/// An array of height x width x 3, without a copy.
pub fn color_image(py: Python<'_>, image: RgbImage) -> PyResult<Bound<'_, PyArray3<u8>>> {
    let shape = [image.height() as usize, image.width() as usize, 3];
    numpy::PyArrayMethods::reshape(&image.into_raw().into_pyarray(py), shape)
}

/// A picture in 8 bits: an array of height x width, or height x width x 3 if it is in colour.
pub fn image_array(py: Python<'_>, picture: Picture) -> PyResult<Bound<'_, PyAny>> {
    match picture.into_8_bits() {
        Picture::Rgb(image) => Ok(color_image(py, image)?.into_any()),
        picture => {
            let (width, height) = picture.dimensions();
            Ok(map(py, Raster::new(width as usize, height as usize, picture.to_gray().into_raw()))?.into_any())
        }
    }
}
