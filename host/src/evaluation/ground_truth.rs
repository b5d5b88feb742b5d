//! Reading the ground truth of data sets.

use std::path::Path;

use image::DynamicImage;

use super::dataset::Dataset;
use crate::{
    error::{Error, Result},
    files::{image_codec, input},
    images::FloatImage,
};

/// Reads a ground truth file of a data set: disparities in pixels at the default baseline, +inf where unknown.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] if the file is not what the data set uses.
pub fn read(dataset: Dataset, path: &Path) -> Result<FloatImage> {
    match dataset {
        Dataset::Middlebury2006Third => read_gray(path, 12.0),
        Dataset::Middlebury2005Full => read_gray(path, 4.0),
        Dataset::Tsukuba => read_gray(path, 16.0),
        // The file counts pixels per camera step, and the default baseline is four steps.
        Dataset::Hci4d(_) => Ok(FloatImage::read_pfm(path)?.map(|step| 4.0 * step)),
    }
}

/// Reads an 8-bit grey image of disparities times `scale`, 0 where unknown.
fn read_gray(path: &Path, scale: f32) -> Result<FloatImage> {
    let gray = match image_codec::decode(path, &input::read(path)?)? {
        DynamicImage::ImageLuma8(gray) => gray,
        other => {
            let found = format!("an image of {:?}", other.color());
            return Err(Error::format(path, found, "disparities in an 8-bit grey image (L8)"));
        }
    };
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    let disparity = |&gray: &u8| if gray == 0 { f32::INFINITY } else { f32::from(gray) / scale };
    Ok(FloatImage::new(width, height, gray.as_raw().iter().map(disparity).collect()))
}
