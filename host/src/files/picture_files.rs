//! Reading and writing pictures.

use std::path::Path;

use image::{DynamicImage, GrayImage, Luma};
use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    files::{
        Limits,
        disparity_files::{decode_pfm, is_pfm},
        image_codec,
    },
    images::{BitDepth, FloatImage, Picture},
};

impl Picture {
    /// Reads a PNG, PGM, PPM, JPEG or PFM file. The contents decide the format, not the name.
    ///
    /// 16-bit samples are scaled so that white is 65535, rounded to nearest. White is the maximum that a PGM or PPM names, or
    /// else the largest number of [`BitDepth::of_brightest`] bits of this picture: read the pictures of one capture with
    /// [`Picture::read_within`]. A PFM holds grey values from 0 to 1, which are rounded to 8 bits. The picture is turned as
    /// its EXIF orientation says, and transparency is dropped.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if the file has another format or is truncated or damaged, or
    /// [`Error::PictureSize`] if it has a side of 0 or more than 65535 pixels, or more than [`Limits::DEFAULT`] in all. A JPEG
    /// is damaged if its codes end too early or too late; a change of its bits that leaves them in step cannot be told.
    pub fn read(path: &Path) -> Result<Picture> {
        Picture::read_within(path, None, Limits::DEFAULT)
    }

    /// Reads a file as [`Picture::read`] does, of a size within `limits`, and with this depth of 16-bit samples if there is
    /// one. The depth does not matter to 8-bit files, nor to a PGM or PPM that names another maximum than 65535.
    ///
    /// # Errors
    /// Those of [`Picture::read`], and [`Error::Format`] if a sample is above the maximum of the depth.
    pub fn read_within(path: &Path, depth: Option<BitDepth>, limits: Limits) -> Result<Picture> {
        decode(path, &limits.read(path)?, depth, limits)
    }

    /// The brightest of all 16-bit samples in files, for [`BitDepth::of_brightest`]. A PGM or PPM that names another maximum
    /// than 65535 does not count. `None` if no file has such samples.
    ///
    /// # Errors
    /// Those of [`Picture::read`]. Files whose samples do not count are not decoded, and may be damaged.
    pub fn brightest(paths: &[&Path], limits: Limits) -> Result<Option<u16>> {
        let brightest = |path: &&Path| {
            let bytes = limits.read(path)?;
            if is_pfm(&bytes) || !image_codec::is_depth_unknown(path, &bytes, limits)? {
                return Ok(None);
            }
            Ok(Some(brightest_of(&without_alpha(image_codec::decode(path, &bytes, limits)?))))
        };
        // All are waited for, so that the error is always that of the first file.
        let found: Vec<Result<Option<u16>>> = paths.par_iter().map(brightest).collect();
        found.into_iter().try_fold(None, |brightest, found| Ok(brightest.max(found?)))
    }

    /// Decodes the bytes of a file of this path, or of a camera's frame.
    #[cfg(any(test, all(target_os = "linux", feature = "v4l2")))]
    pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<Picture> {
        decode(path, bytes, None, Limits::DEFAULT)
    }

    /// Writes a PNG file of the picture's depth.
    ///
    /// # Errors
    /// [`Error::Write`]. Any previous version of the file is unchanged.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        match self {
            Picture::Gray(gray) => image_codec::write_png(path, gray),
            Picture::Rgb(rgb) => image_codec::write_png(path, rgb),
            Picture::Gray16(gray) => image_codec::write_png(path, gray),
            Picture::Rgb16(rgb) => image_codec::write_png(path, rgb),
        }
    }
}

fn decode(path: &Path, bytes: &[u8], depth: Option<BitDepth>, limits: Limits) -> Result<Picture> {
    if is_pfm(bytes) {
        return from_float(path, &decode_pfm(path, bytes, limits)?);
    }
    let mut picture = without_alpha(image_codec::decode(path, bytes, limits)?);
    if image_codec::is_depth_unknown(path, bytes, limits)? {
        let brightest = brightest_of(&picture);
        let depth = depth.unwrap_or(BitDepth::of_brightest(brightest));
        if brightest > depth.white() {
            let expected = format!("at most {}, the maximum of {} bits", depth.white(), depth.bits());
            return Err(Error::format(path, format!("a sample of {brightest}"), expected));
        }
        samples_mut(&mut picture).iter_mut().for_each(|sample| *sample = depth.to_16_bits(*sample));
    }
    Ok(picture)
}

/// Drops the alpha channel. The formats read give integer samples of 8 or 16 bits only.
fn without_alpha(image: DynamicImage) -> Picture {
    let color = image.color();
    let has_16_bits = color.bytes_per_pixel() > color.channel_count();
    match (color.has_color(), has_16_bits) {
        (false, false) => Picture::Gray(image.into_luma8()),
        (true, false) => Picture::Rgb(image.into_rgb8()),
        (false, true) => Picture::Gray16(image.into_luma16()),
        (true, true) => Picture::Rgb16(image.into_rgb16()),
    }
}

fn samples_mut(picture: &mut Picture) -> &mut [u16] {
    match picture {
        Picture::Gray16(gray) => gray,
        Picture::Rgb16(rgb) => rgb,
        Picture::Gray(_) | Picture::Rgb(_) => &mut [],
    }
}

/// The brightest 16-bit sample of a picture, 0 if it has none.
fn brightest_of(picture: &Picture) -> u16 {
    let samples: &[u16] = match picture {
        Picture::Gray16(gray) => gray,
        Picture::Rgb16(rgb) => rgb,
        Picture::Gray(_) | Picture::Rgb(_) => &[],
    };
    samples.iter().copied().max().unwrap_or_default()
}

fn from_float(path: &Path, image: &FloatImage) -> Result<Picture> {
    if let Some(value) = image.pixels().iter().find(|value| !(0.0..=1.0).contains(*value)) {
        return Err(Error::format(
            path,
            format!("a PFM file with the value {value} (is it a disparity or depth map?)"),
            "an image, with values from 0 to 1",
        ));
    }
    let gray = |u, v| Luma([(255.0 * image.get(u as usize, v as usize)).round() as u8]);
    Ok(Picture::Gray(GrayImage::from_fn(image.width() as u32, image.height() as u32, gray)))
}

#[cfg(test)]
mod tests;
