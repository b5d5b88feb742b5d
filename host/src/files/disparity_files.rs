//! Reading and writing disparity maps and depths: PFM and 16-bit PNG.

use std::path::Path;

use image::{DynamicImage, ImageBuffer, Luma};
use multiscopic_core::Disparity;

use crate::{
    error::{Error, Result},
    files::{Limits, image_codec},
    images::{DisparityMap, Geometry, Raster},
};

/// Writes a 16-bit PNG file: 64 times the disparity plus 32768, or 0 where invalid. This is lossless.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_raw16(map: &DisparityMap, path: &Path) -> Result<()> {
    let samples = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
    image_codec::write_png(path, &gray16(map.width(), map.height(), samples))
}

/// Writes the depths of a map as a 16-bit PNG file in millimetres, rounded; 0 where unknown or beyond 65.535 m, as depth
/// cameras do.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_depth_mm(map: &DisparityMap, geometry: &Geometry, path: &Path) -> Result<()> {
    let millimetres = |&metres: &f32| (1e3 * f64::from(metres)).round();
    let sample = |metres| Some(millimetres(metres)).filter(|mm| (1.0..=65535.0).contains(mm)).map_or(0, |mm| mm as u16);
    let samples = geometry.depths(map).pixels().iter().map(sample).collect();
    image_codec::write_png(path, &gray16(map.width(), map.height(), samples))
}

/// Reads a file that [`write_raw16`] wrote.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] if the file is damaged or is not a 16-bit grey image.
pub fn read_raw16(path: &Path) -> Result<DisparityMap> {
    read_raw16_within(path, Limits::DEFAULT)
}

fn read_raw16_within(path: &Path, limits: Limits) -> Result<DisparityMap> {
    match image_codec::decode(path, &limits.read(path)?, limits)? {
        DynamicImage::ImageLuma16(image) => {
            let (width, height) = (image.width() as usize, image.height() as usize);
            Ok(Raster::new(width, height, image.into_raw()).map(|&raw| Disparity::from_raw16(raw)))
        }
        other => {
            let found = format!("an image of {:?}", other.color());
            Err(Error::format(path, found, "disparities in a 16-bit grey image (L16)"))
        }
    }
}

/// Reads a file that [`write_raw16`] wrote, to search around its disparities in frames of
/// `width` x `height` pixels. It has a size within `limits`.
///
/// # Errors
/// As [`read_raw16`], and [`Error::Format`] if the map has another size or no valid pixel.
pub fn read_prior(path: &Path, [width, height]: [usize; 2], limits: Limits) -> Result<DisparityMap> {
    let prior = read_raw16_within(path, limits)?;
    let [w, h] = [prior.width(), prior.height()];
    if [w, h] != [width, height] {
        let expected = format!("{width}x{height} as the images have");
        return Err(Error::format(path, format!("disparities of {w}x{h} pixels"), expected));
    }
    if prior.range().is_none() {
        return Err(Error::format(path, "no pixel with a disparity", "disparities to search around"));
    }
    Ok(prior)
}

fn gray16(width: usize, height: usize, samples: Vec<u16>) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    ImageBuffer::from_raw(width as u32, height as u32, samples).expect("a sample for every pixel")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Picture;
    use multiscopic_core::Disparity;

    fn disparity(pixels: f32) -> Option<Disparity> {
        Disparity::from_bits((pixels * 64.0) as i16)
    }

    fn map() -> DisparityMap {
        DisparityMap::new(
            3,
            2,
            vec![disparity(-2.5), None, disparity(60.0), disparity(0.0), disparity(511.984_4), disparity(-511.984_4)],
        )
    }

    #[test]
    fn raw16_is_lossless() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("raw.png");
        write_raw16(&map(), &path).unwrap();
        assert_eq!(read_raw16(&path).unwrap(), map());
        let image = image::open(&path).unwrap().into_luma16();
        assert_eq!(image.into_raw(), [32768 - 160, 0, 32768 + 3840, 32768, 65535, 1]);
    }

    #[test]
    fn a_colour_image_is_not_raw16() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("color.png");
        Picture::Rgb(crate::images::turbo(&map(), None)).write_png(&path).unwrap();
        let message = read_raw16(&path).unwrap_err().to_string();
        assert!(message.contains("found an image of Rgb8, expected disparities"), "{message}");
    }

    #[test]
    fn invalid_pixels_are_infinite_in_a_pfm() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("d.pfm");
        crate::files::write_pfm(&map().to_float(), &path).unwrap();
        let read = crate::files::read_pfm(&path).unwrap();
        assert_eq!(read.pixels()[..4], [-2.5, f32::INFINITY, 60.0, 0.0]);
    }
}
