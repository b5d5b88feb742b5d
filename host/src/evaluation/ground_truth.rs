//! Reading ground truth.

use std::path::Path;

use image::DynamicImage;

use super::dataset::Dataset;
use crate::{
    error::{Error, Result},
    files::{Limits, image_codec},
    images::FloatImage,
};

/// Reads a ground truth file of a data set: disparities in pixels at the default baseline, +inf where unknown.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] if the file is not what the data set uses.
pub(super) fn read(dataset: Dataset, path: &Path, limits: Limits) -> Result<FloatImage> {
    match dataset {
        Dataset::Middlebury2006Third => read_gray(path, 12.0, limits),
        Dataset::Middlebury2005Full => read_gray(path, 4.0, limits),
        Dataset::Tsukuba => read_gray(path, 16.0, limits),
        // The file counts pixels per camera step, and the default baseline is four steps.
        Dataset::Hci4d(_) => Ok(crate::files::read_pfm_within(path, limits)?.map(|step| 4.0 * step)),
    }
}

/// Reads the true disparities of an image of a size, from the file `center`: a PFM file in pixels, not finite where unknown.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] if it is no PFM file, the sizes differ, or no disparity is known.
pub fn read_pfm(path: &Path, size: [usize; 2], center: &Path, limits: Limits) -> Result<FloatImage> {
    let truth = crate::files::read_pfm_within(path, limits)?;
    check(path, &truth, size, center)?;
    Ok(truth)
}

/// Refuses the ground truth in the file `path` if its size is not that of the image in `center`, or if no disparity is known.
pub(super) fn check(path: &Path, truth: &FloatImage, [width, height]: [usize; 2], center: &Path) -> Result<()> {
    let (w, h) = (truth.width(), truth.height());
    if (w, h) != (width, height) {
        let expected = format!("{width}x{height} as in {}", center.display());
        return Err(Error::format(path, format!("disparities of {w}x{h} pixels"), expected));
    }
    match truth.pixels().iter().any(|d| d.is_finite()) {
        true => Ok(()),
        false => Err(Error::format(path, "no pixel with a disparity", "the ground truth of the centre image")),
    }
}

/// Reads an 8-bit grey image of disparities times `scale`, 0 where unknown.
fn read_gray(path: &Path, scale: f32, limits: Limits) -> Result<FloatImage> {
    let gray = match image_codec::decode(path, &limits.read(path)?, limits)? {
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
