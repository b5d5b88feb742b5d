//! Reading disparity maps, and writing them and depths as 16-bit PNG.

use std::{fmt, ops::RangeInclusive, path::Path};

use image::{DynamicImage, ImageBuffer, Luma};
use multiscopic_core::Disparity;

use super::{
    Limits,
    image_codec::{self, CodedFile, Decoded, Numbers},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, FloatImage, Geometry},
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

/// The numbers that a file has for disparities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DisparityEncoding {
    /// Disparities in pixels.
    Pixels,
    /// 64 times the disparity plus 32768, and 0 where invalid, as [`write_raw16`] writes.
    Raw16,
    /// 256 times the disparity, and 0 where invalid.
    Kitti,
    /// 16 times the disparity, and 0 or less where invalid.
    OpenCv,
}

impl DisparityEncoding {
    /// The disparity of a number, +inf where invalid.
    fn disparity(self, number: f32) -> f32 {
        let scaled = |number: f32, scale: f32| if number > 0.0 { number / scale } else { f32::INFINITY };
        match self {
            DisparityEncoding::Pixels => number,
            DisparityEncoding::Raw16 => Disparity::from_raw16(number as u16).map_or(f32::INFINITY, f32::from),
            DisparityEncoding::Kitti => scaled(number, 256.0),
            // Signed numbers may be stored as if they had no sign.
            DisparityEncoding::OpenCv => scaled(if number >= 32768.0 { number - 65536.0 } else { number }, 16.0),
        }
    }
}

impl fmt::Display for DisparityEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DisparityEncoding::Pixels => "disparities in pixels",
            DisparityEncoding::Raw16 => "64 times the disparity plus 32768, as multiscopic stores it",
            DisparityEncoding::Kitti => "256 times the disparity, as KITTI stores it",
            DisparityEncoding::OpenCv => "16 times the disparity, as OpenCV stores it",
        })
    }
}

/// The images that disparities should belong to.
#[derive(Clone, Debug)]
pub struct MatchedImages<'a> {
    /// The file of the centre.
    pub center: &'a Path,
    /// Width and height.
    pub size: [usize; 2],
    /// The disparities that the images show, if they do, in pixels: those of [`Inspection::shown_range`](crate::Inspection).
    pub shown: Option<RangeInclusive<i16>>,
}

/// The share of disparities within the range that the images show, below which a map belongs to others, or is of other numbers.
const MIN_SHOWN: f64 = 0.25;
/// The least median of disparities in [`DisparityEncoding::Raw16`], unless the images show others: cameras look ahead.
const MIN_MEDIAN: f32 = -64.0;

/// Reads disparities in pixels, not finite where unknown: a PFM, NPY, NPZ or TIFF file of real numbers, or whole ones of 16 bits
/// in a PNG, TIFF or NPY file. Of these, the numbers tell the encoding: the only one with plausible disparities for `images`, if
/// they are known.
///
/// # Errors
/// [`Error::Read`], [`Error::PictureSize`], and [`Error::Format`] if the file has other contents or is damaged, the size is not
/// that of the images, no pixel has a disparity, or most disparities are far from those that the images show.
pub fn read_disparities(
    path: &Path,
    images: Option<&MatchedImages<'_>>,
    limits: Limits,
) -> Result<(FloatImage, DisparityEncoding)> {
    use DisparityEncoding::{Kitti, OpenCv, Pixels, Raw16};
    let (numbers, encodings, is_first_likely): (FloatImage, &[_], bool) =
        match CodedFile::new(path, &limits.read(path)?, limits)?.decode()? {
            Decoded::Numbers(Numbers { map, is_whole: false }) => (map, &[Pixels], true),
            Decoded::Numbers(Numbers { map, is_whole: true }) => (map, &[Pixels, OpenCv, Kitti], false),
            Decoded::Samples(DynamicImage::ImageLuma16(image)) => {
                let numbers = image.as_raw().iter().map(|&sample| sample.into()).collect();
                (FloatImage::new(image.width() as usize, image.height() as usize, numbers), &[Raw16, Kitti, OpenCv], true)
            }
            Decoded::Samples(other) => {
                let found = format!("an image of {:?}", other.color());
                let expected = "disparities: in pixels as PFM, NPY or TIFF of real numbers, or in a 16-bit grey image (L16)";
                return Err(Error::format(path, found, expected));
            }
        };
    if let Some(images) = images {
        images.check_size(path, &numbers)?;
    }
    let decoded = |&encoding: &DisparityEncoding| {
        let map = numbers.map(|&number| encoding.disparity(number));
        (median(&map), map, encoding)
    };
    let maps: Vec<(Option<f32>, FloatImage, DisparityEncoding)> = encodings.iter().map(decoded).collect();
    let is_plausible = |(median, map, encoding): &(Option<f32>, FloatImage, DisparityEncoding)| {
        let &Some(median) = median else { return images.is_none() };
        let width = map.width() as f32;
        match (images.and_then(|images| images.shown.as_ref()), encoding) {
            (Some(shown), _) => share_within(map, shown) >= MIN_SHOWN,
            (None, Pixels) => true,
            (None, Raw16) => (MIN_MEDIAN..=width).contains(&median),
            (None, Kitti | OpenCv) => median <= width / 4.0,
        }
    };
    let plausible: Vec<usize> = (0..maps.len()).filter(|&i| is_plausible(&maps[i])).collect();
    if let [i] | [i @ 0, ..] = plausible[..]
        && (plausible.len() == 1 || is_first_likely)
    {
        let (_, map, encoding) = maps.into_iter().nth(i).expect("its place is among them");
        return Ok((map, encoding));
    }
    let medians: Vec<String> =
        maps.iter().filter_map(|(median, _, encoding)| Some(format!("{:.1} ({encoding})", (*median)?))).collect();
    if medians.is_empty() {
        return Err(Error::format(path, "no pixel with a disparity", "the disparities of the centre image"));
    }
    let expected = match images.and_then(|images| images.shown.as_ref()) {
        Some(shown) => format!("some from {} to {}, as the images show", shown.start(), shown.end()),
        None => "one of these alone to be plausible".into(),
    };
    let found = format!("disparities near {} pixels", medians.join(", or "));
    Err(Error::Format { path: path.into(), found, expected: format!("{expected}: store them in pixels, as PFM or NPY") })
}

impl MatchedImages<'_> {
    /// Refuses a map of another size.
    pub(crate) fn check_size(&self, path: &Path, map: &FloatImage) -> Result<()> {
        let ([w, h], [width, height]) = ([map.width(), map.height()], self.size);
        if [w, h] == self.size {
            return Ok(());
        }
        let expected = format!("{width}x{height} as in {}", self.center.display());
        Err(Error::format(path, format!("disparities of {w}x{h} pixels"), expected))
    }
}

/// The median of the known disparities.
fn median(map: &FloatImage) -> Option<f32> {
    let mut known: Vec<f32> = map.pixels().iter().copied().filter(|d| d.is_finite()).collect();
    let middle = known.len() / 2;
    (!known.is_empty()).then(|| *known.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// The share of the known disparities in a range, or beyond it by half of it: images show it at their corners.
fn share_within(map: &FloatImage, range: &RangeInclusive<i16>) -> f64 {
    let [start, end] = [*range.start(), *range.end()].map(f32::from);
    let margin = (0.5 * (end - start)).max(2.0);
    let known = map.pixels().iter().filter(|d| d.is_finite());
    let within = known.clone().filter(|&&d| (start - margin..=end + margin).contains(&d)).count();
    within as f64 / known.count() as f64
}

fn gray16(width: usize, height: usize, samples: Vec<u16>) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    ImageBuffer::from_raw(width as u32, height as u32, samples).expect("a sample for every pixel")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Picture;

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
        let (read, encoding) = read_disparities(&path, None, Limits::DEFAULT).unwrap();
        assert_eq!((DisparityMap::from_float(&read), encoding), (map(), DisparityEncoding::Raw16));
        let image = image::open(&path).unwrap().into_luma16();
        assert_eq!(image.into_raw(), [32768 - 160, 0, 32768 + 3840, 32768, 65535, 1]);
    }

    #[test]
    fn a_colour_image_is_not_raw16() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("color.png");
        Picture::Rgb(crate::images::turbo(&map(), None)).write_png(&path).unwrap();
        let message = read_disparities(&path, None, Limits::DEFAULT).unwrap_err().to_string();
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
