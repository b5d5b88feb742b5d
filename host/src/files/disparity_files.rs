//! Reading and writing disparity maps and depths: 16-bit PNG, and PFM, images of floating-point numbers as the Middlebury
//! benchmark uses for disparities.

use std::{path::Path, str::FromStr};

use image::{DynamicImage, ImageBuffer, Luma};
use multiscopic_core::Disparity;

use super::{Limits, image_codec, output};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, FloatImage, Geometry, Raster},
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

/// Reads a PFM file with one channel, in either byte order.
///
/// As in the Middlebury tools, the sign of the scale gives the byte order, and its magnitude is ignored. Rows come from the bottom,
/// except in Photoshop's files, whose width and height have a line each.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`] if the file has another format, or is shorter or longer than its
/// header says, and [`Error::PictureSize`] if it is too large.
pub fn read_pfm(path: &Path) -> Result<FloatImage> {
    read_pfm_within(path, Limits::DEFAULT)
}

/// Reads a PFM file as [`read_pfm`] does, of a size within `limits`.
///
/// # Errors
/// Those of [`read_pfm`].
pub fn read_pfm_within(path: &Path, limits: Limits) -> Result<FloatImage> {
    decode_pfm(path, &limits.read(path)?, limits)
}

/// Writes a PFM file: rows from bottom to top, little-endian.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_pfm(image: &FloatImage, path: &Path) -> Result<()> {
    output::write(path, |writer| writer.write_all(&pfm_bytes(image)))
}

/// The bytes of a PFM file.
pub fn pfm_bytes(image: &FloatImage) -> Vec<u8> {
    let mut bytes = format!("Pf\n{} {}\n-1.0\n", image.width(), image.height()).into_bytes();
    bytes.extend(image.rows().rev().flatten().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Returns true if a file with these contents is a PFM file, grey or in colour.
pub(crate) fn is_pfm(bytes: &[u8]) -> bool {
    bytes.starts_with(b"Pf") || bytes.starts_with(b"PF")
}

/// Decodes the contents of the file `path`.
pub(crate) fn decode_pfm(path: &Path, bytes: &[u8], limits: Limits) -> Result<FloatImage> {
    let expected = "a PFM file with one channel: Pf, width, height and scale, then the pixels";
    let mut rest = bytes;
    match next_word(&mut rest) {
        Some("Pf") => {}
        Some("PF") => return Err(Error::format(path, "a PFM file in colour (PF)", expected)),
        _ => return Err(Error::format(path, "another kind of file", expected)),
    }
    let width = next_number(path, &mut rest, "width")?;
    // Photoshop gives each side a line of its own, and writes the rows from the top.
    let is_from_the_top = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).any(|byte| b"\r\n".contains(byte));
    let height = next_number(path, &mut rest, "height")?;
    let scale: f32 = next_number(path, &mut rest, "scale")?;
    if !scale.is_finite() || scale == 0.0 {
        return Err(Error::format(path, format!("a PFM scale of {scale}"), "-1 (little-endian) or 1 (big-endian)"));
    }
    limits.check_size(path, width, height)?;
    let (width, height) = (width as usize, height as usize);
    let bytes = 4 * width * height;
    // One white-space character ends the header. Some programs write several.
    let blanks = rest.len().saturating_sub(bytes);
    let Some((_, pixels)) =
        rest.split_at_checked(blanks).filter(|(blanks, _)| !blanks.is_empty() && blanks.trim_ascii().is_empty())
    else {
        let found = format!("{} bytes of pixels", rest.len().saturating_sub(1));
        return Err(Error::format(path, found, format!("{bytes} for {width}x{height} pixels")));
    };

    let value = if scale > 0.0 { f32::from_be_bytes } else { f32::from_le_bytes };
    let mut rows: Vec<&[u8]> = pixels.chunks_exact(4 * width).collect();
    if !is_from_the_top {
        rows.reverse();
    }
    let pixels = rows.into_iter().flat_map(|row| row.as_chunks().0.iter().map(|&bytes| value(bytes))).collect();
    Ok(FloatImage::new(width, height, pixels))
}

/// Takes the next word of the header, which white space ends, from the front of `rest`.
fn next_word<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let start = rest.trim_ascii_start();
    let length = start.iter().position(u8::is_ascii_whitespace)?;
    let (word, end) = start.split_at(length);
    *rest = end;
    str::from_utf8(word).ok()
}

fn next_number<T: FromStr>(path: &Path, rest: &mut &[u8], name: &str) -> Result<T> {
    let word = next_word(rest).unwrap_or_default();
    word.parse().map_err(|_| Error::format(path, format!("{word:?} as the {name} of a PFM file"), "a number"))
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

    fn decode(bytes: &[u8]) -> Result<FloatImage> {
        decode_pfm(Path::new("d.pfm"), bytes, Limits::DEFAULT)
    }

    fn message(bytes: &[u8]) -> String {
        decode(bytes).unwrap_err().to_string()
    }

    #[test]
    fn writing_and_reading_gives_the_same_image() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("d.pfm");
        let image = FloatImage::new(3, 2, vec![1.5, -2.0, f32::INFINITY, 0.0, 1e30, 7.0]);
        crate::files::write_pfm(&image, &path).unwrap();
        assert_eq!(crate::files::read_pfm(&path).unwrap(), image);
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.starts_with(b"Pf\n3 2\n-1.0\n\0\0\0\0"), "the bottom row comes first");
        assert_eq!(bytes.len(), 12 + 24);
    }

    #[test]
    fn both_byte_orders_and_any_white_space() {
        let pixels = [0.5f32, 3.0];
        let (little, big) = (pixels.map(f32::to_le_bytes).concat(), pixels.map(f32::to_be_bytes).concat());
        for header in ["Pf\n1 2\n-1\n", "Pf 1  2\t-0.003922 ", "Pf\r\n1 2\r\n-1.0\r\n", "Pf\n1 2\n-1.0 \n"] {
            assert_eq!(decode(&[header.as_bytes(), &little].concat()).unwrap().pixels(), [3.0, 0.5], "{header:?}");
        }
        assert_eq!(decode(&[b"Pf\n1 2\n1\n", &big[..]].concat()).unwrap().pixels(), [3.0, 0.5]);
        for header in ["Pf\n1\n2\n-1.0\n", "Pf\r\n1\r\n2\r\n-1e3\r\n"] {
            assert_eq!(decode(&[header.as_bytes(), &little].concat()).unwrap().pixels(), [0.5, 3.0], "{header:?} of Photoshop");
        }
        // The first pixel may consist of white-space characters.
        assert_eq!(decode(b"Pf\n1 1\n-1\n\n\n\n\n").unwrap().pixels(), [f32::from_le_bytes([10; 4])]);
    }

    #[test]
    fn says_what_is_wrong() {
        assert!(message(b"PF\n1 1\n-1\n____________").starts_with("d.pfm: found a PFM file in colour"));
        assert!(message(b"P5\n1 1\n255\n_").contains("another kind of file"));
        assert!(message(b"Pf\n1 x\n-1\n____").contains("found \"x\" as the height of a PFM file"));
        for scale in ["0", "nan", "inf", "", "-"] {
            assert!(message(format!("Pf\n1 1\n{scale}\n").as_bytes()).contains("scale"));
        }
        for size in ["99999 99999", "4000000000 1", "4000000000 4000000000", "0 1", "65535 65535"] {
            assert!(message(format!("Pf {size} -1\n").as_bytes()).contains("found a picture of "), "{size}");
        }
        assert!(message(b"Pf 2 1 -1\n_______").contains("found 7 bytes of pixels, expected 8"));
        assert!(message(b"Pf 2 1 -1\n_________").contains("found 9 bytes"));
    }
}
