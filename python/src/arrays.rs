//! Numpy arrays as pictures and maps, and back.

use image::{ImageBuffer, RgbImage};
use multiscopic::{DisparityMap, Error, FloatImage, Picture, Raster, images::BitDepth};
use numpy::{
    AllowTypeChange, Element, IntoPyArray, PyArray, PyArray2, PyArray3, PyArrayLike2, PyReadonlyArrayDyn, PyUntypedArrayMethods,
    ndarray::IntoDimension,
};
use pyo3::{exceptions::PyTypeError, prelude::*};

use crate::interpreter::exception;

/// An image as it comes from Python: of height x width or height x width x 3 (RGB), in any order of memory.
pub enum ImageArray<'py> {
    /// uint8.
    Shallow(PyReadonlyArrayDyn<'py, u8>),
    /// uint16, of which some bits carry values.
    Deep(PyReadonlyArrayDyn<'py, u16>),
}

impl<'py> FromPyObject<'_, 'py> for ImageArray<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<ImageArray<'py>> {
        let deep = |_: PyErr| object.extract().map(ImageArray::Deep);
        object.extract().map(ImageArray::Shallow).or_else(deep).map_err(|_: PyErr| {
            let kind = object.getattr("dtype").unwrap_or_else(|_| object.get_type().into_any());
            PyTypeError::new_err(format!("an image is an array of uint8 or uint16, not {kind}"))
        })
    }
}

impl ImageArray<'_> {
    /// The brightest sample of 16 bits, if it has some.
    pub fn brightest(&self) -> Option<u16> {
        match self {
            ImageArray::Shallow(_) => None,
            ImageArray::Deep(array) => array.as_array().iter().max().copied(),
        }
    }

    fn shape(&self) -> &[usize] {
        match self {
            ImageArray::Shallow(array) => array.shape(),
            ImageArray::Deep(array) => array.shape(),
        }
    }
}

/// The number of bits of uint16 that carry values: the keyword argument `bits`.
#[derive(Clone, Copy, Debug)]
pub struct Bits(pub BitDepth);

impl FromPyObject<'_, '_> for Bits {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<Bits> {
        let bits: u8 = object.extract()?;
        let refused = |_| exception(Error::Usage(format!("bits is {bits}, it must be one of 10, 12, 14, 16")));
        BitDepth::try_from(bits).map(Bits).map_err(refused)
    }
}

/// Numbers of height x width, which become float32.
pub type FloatArray<'py> = PyArrayLike2<'py, f32, AllowTypeChange>;

/// Disparities to search around, in pixels: the keyword argument `prior`.
#[derive(Clone, Debug)]
pub struct PriorArray(pub DisparityMap);

impl FromPyObject<'_, '_> for PriorArray {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<PriorArray> {
        let array: FloatArray<'_> = object.extract()?;
        Ok(PriorArray(DisparityMap::from_float(&float_image(&array, "prior")?)))
    }
}

/// A copy of an image, whose uint16 have this depth. `name` stands for it in errors.
pub fn picture(array: &ImageArray<'_>, name: &str, depth: BitDepth) -> PyResult<Picture> {
    if let Some(brightest) = array.brightest().filter(|sample| *sample > depth.white()) {
        let (white, bits) = (depth.white(), depth.bits());
        let message = format!("{name} has a sample of {brightest}, it must be at most {white}, the maximum of {bits} bits");
        return Err(exception(Error::Usage(message)));
    }
    let deep = |array| samples(array, |sample| depth.to_16_bits(sample));
    let picture = match (array, array.shape()) {
        (_, [0, ..] | [_, 0, ..]) => None,
        (ImageArray::Shallow(array), &[height, width]) => {
            ImageBuffer::from_raw(width as u32, height as u32, samples(array, |sample| sample)).map(Picture::Gray)
        }
        (ImageArray::Shallow(array), &[height, width, 3]) => {
            ImageBuffer::from_raw(width as u32, height as u32, samples(array, |sample| sample)).map(Picture::Rgb)
        }
        (ImageArray::Deep(array), &[height, width]) => {
            ImageBuffer::from_raw(width as u32, height as u32, deep(array)).map(Picture::Gray16)
        }
        (ImageArray::Deep(array), &[height, width, 3]) => {
            ImageBuffer::from_raw(width as u32, height as u32, deep(array)).map(Picture::Rgb16)
        }
        _ => None,
    };
    picture.ok_or_else(|| {
        let message = format!("{name} has the shape {:?}, it must be (height, width) or (height, width, 3)", array.shape());
        exception(Error::Usage(message))
    })
}

/// The samples row by row, as `convert` makes them.
fn samples<T: Element + Copy>(array: &PyReadonlyArrayDyn<'_, T>, convert: impl Fn(T) -> T) -> Vec<T> {
    // The slice of numpy's crate would be in the order of memory, which need not be that of rows.
    match array.as_array().as_slice() {
        Some(samples) => samples.iter().copied().map(convert).collect(),
        None => array.as_array().iter().copied().map(convert).collect(),
    }
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
    in_shape(py, raster.into_pixels(), shape)
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
    in_shape(py, image.into_raw(), shape)
}

/// An array of height x width, or height x width x 3 if the picture is in colour: uint8, or uint16 if it has 16 bits.
pub fn image_array(py: Python<'_>, picture: Picture) -> PyResult<Bound<'_, PyAny>> {
    let (width, height) = picture.dimensions();
    let (height, width) = (height as usize, width as usize);
    Ok(match picture {
        Picture::Gray(image) => in_shape(py, image.into_raw(), [height, width])?.into_any(),
        Picture::Rgb(image) => color_image(py, image)?.into_any(),
        Picture::Gray16(image) => in_shape(py, image.into_raw(), [height, width])?.into_any(),
        Picture::Rgb16(image) => in_shape(py, image.into_raw(), [height, width, 3])?.into_any(),
    })
}

/// An array of this shape, without a copy.
pub fn in_shape<T: Element, S: IntoDimension>(
    py: Python<'_>,
    samples: Vec<T>,
    shape: S,
) -> PyResult<Bound<'_, PyArray<T, S::Dim>>> {
    numpy::PyArrayMethods::reshape(&samples.into_pyarray(py), shape)
}
