//! The lens of a photo, by its EXIF.

use std::{io::Cursor, path::Path};

use exif::{Exif, In, Reader, Tag, Value};

use super::Limits;
use crate::{caught::caught, error::Result};

/// The diagonal of a frame of 35 mm film, 36 x 24 mm, by which equivalent focal lengths are reckoned (CIPA DCG-001).
const FILM_DIAGONAL_MM: f64 = 43.266_615;

/// A focal length and what it was found from.
#[derive(Clone, Debug, PartialEq)]
pub struct ExifFocal {
    /// The focal length in pixels of the photo. Makers round: it may be off by some percent.
    pub focal_px: f64,
    /// The fields that tell it, in words.
    pub source: String,
}

/// The focal length that the EXIF of a photo of this size in pixels tells: by the focal length and the resolution of the sensor, or
/// else by the focal length that is equivalent on film. `None` if it tells none.
///
/// # Errors
/// [`Error::Read`](crate::Error::Read). EXIF that is damaged tells nothing.
pub fn exif_focal(path: &Path, [width, height]: [usize; 2], limits: Limits) -> Result<Option<ExifFocal>> {
    let bytes = limits.read(path)?;
    let exif = caught(|| Reader::new().read_from_container(&mut Cursor::new(&bytes)).ok()).ok().flatten();
    let (long, diagonal) = (width.max(height) as f64, (width as f64).hypot(height as f64));
    Ok(exif.and_then(|exif| by_sensor(&exif, long).or_else(|| by_film(&exif, diagonal))))
}

/// By the pixels of the sensor, of which the photo may have fewer: `long` on its longer side.
fn by_sensor(exif: &Exif, long: f64) -> Option<ExifFocal> {
    let focal_mm = number(exif, Tag::FocalLength)?;
    let per_unit = number(exif, Tag::FocalPlaneXResolution)?;
    // Inches unless it says centimetres.
    let (mm, unit) = if number(exif, Tag::FocalPlaneResolutionUnit) == Some(3.0) { (10.0, "cm") } else { (25.4, "inch") };
    let sides = [Tag::PixelXDimension, Tag::PixelYDimension].map(|tag| number(exif, tag));
    let recorded = sides.into_iter().flatten().fold(0.0, f64::max);
    let scale = if recorded > 0.0 { long / recorded } else { 1.0 };
    let source = format!("{focal_mm} mm on a sensor of {per_unit:.0} pixels for each {unit}");
    Some(ExifFocal { focal_px: focal_mm * per_unit / mm * scale, source })
}

fn by_film(exif: &Exif, diagonal: f64) -> Option<ExifFocal> {
    let focal_mm = number(exif, Tag::FocalLengthIn35mmFilm)?;
    let source = format!("a focal length like {focal_mm} mm on 35 mm film");
    Some(ExifFocal { focal_px: focal_mm / FILM_DIAGONAL_MM * diagonal, source })
}

/// The number of a field, above 0. Makers write 0 for what they do not know.
fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let found = match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(numbers) => numbers.first()?.to_f64(),
        value => value.get_uint(0)?.into(),
    };
    Some(found).filter(|number| number.is_finite() && *number > 0.0)
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    /// A TIFF entry of a field, after the EXIF specification (CIPA DC-008, 4.6.2): its tag, its type, the count, the value.
    fn entry(tag: u16, kind: u16, value: u32) -> [u8; 12] {
        let mut bytes = [0; 12];
        bytes[..2].copy_from_slice(&tag.to_be_bytes());
        bytes[2..4].copy_from_slice(&kind.to_be_bytes());
        bytes[4..8].copy_from_slice(&1_u32.to_be_bytes());
        let value = if kind == 3 { value << 16 } else { value };
        bytes[8..].copy_from_slice(&value.to_be_bytes());
        bytes
    }

    /// A JPEG whose EXIF has these fields: tags, and rational numbers or short ones.
    fn photo(path: &Path, fields: &[(u16, Option<[u32; 2]>, u32)]) {
        // The header, a directory with the place of the EXIF directory, and that directory.
        let start = 8 + 2 + 12 + 4;
        let mut rationals = Vec::new();
        let end = start + 2 + 12 * fields.len() as u32 + 4;
        let mut directory = (fields.len() as u16).to_be_bytes().to_vec();
        for (tag, rational, short) in fields {
            match rational {
                Some(numbers) => {
                    directory.extend(entry(*tag, 5, end + rationals.len() as u32));
                    rationals.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
                }
                None => directory.extend(entry(*tag, 3, *short)),
            }
        }
        let tiff =
            [&b"MM\0\x2a\0\0\0\x08\0\x01"[..], &entry(0x8769, 4, start), &[0; 4], &directory, &[0; 4], &rationals].concat();
        let mut jpeg = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut jpeg).encode_image(&GrayImage::new(40, 30)).unwrap();
        let segment = [&b"\xFF\xE1"[..], &(tiff.len() as u16 + 8).to_be_bytes(), b"Exif\0\0", &tiff].concat();
        std::fs::write(path, [&jpeg[..2], &segment, &jpeg[2..]].concat()).unwrap();
    }

    #[test]
    fn the_focal_length_is_that_of_the_sensor_or_of_film() {
        const FOCAL: u16 = 0x920A;
        const X_RESOLUTION: u16 = 0xA20E;
        const UNIT: u16 = 0xA210;
        const FILM: u16 = 0xA405;
        const X_SIZE: u16 = 0xA002;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("photo.jpg");
        let focal = |fields: &[(u16, Option<[u32; 2]>, u32)]| {
            photo(&path, fields);
            exif_focal(&path, [40, 30], Limits::DEFAULT).unwrap().map(|found| found.focal_px)
        };
        // 5 mm on a sensor of 1000 pixels on 10 mm; recorded 80 pixels wide, of which the photo has 40.
        let sensor = [(FOCAL, Some([50, 10]), 0), (X_SIZE, None, 80), (X_RESOLUTION, Some([1000, 1]), 0), (UNIT, None, 3)];
        assert_eq!(focal(&sensor), Some(250.0));
        let inches = focal(&[(FOCAL, Some([127, 10]), 0), (X_RESOLUTION, Some([1000, 1]), 0)]).unwrap();
        assert!((inches - 500.0).abs() < 1e-9, "{inches}");
        let film = focal(&[(FOCAL, Some([50, 10]), 0), (FILM, None, 26)]).unwrap();
        assert!((film - 26.0 * 50.0 / 43.266_615).abs() < 1e-6, "{film}");
        assert_eq!(focal(&[(FOCAL, Some([50, 10]), 0)]), None);
        assert_eq!(focal(&[(FILM, None, 0)]), None);
        assert_eq!(focal(&[(FOCAL, Some([50, 0]), 0), (X_RESOLUTION, Some([1, 0]), 0)]), None);
        std::fs::write(&path, b"no photo").unwrap();
        assert_eq!(exif_focal(&path, [40, 30], Limits::DEFAULT).unwrap(), None);
    }
}
