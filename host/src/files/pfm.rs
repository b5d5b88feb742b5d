//! PFM files: images of floating-point numbers, as the Middlebury benchmark uses for disparities.

use std::{path::Path, str::FromStr};

use super::{Limits, output};
use crate::{
    error::{Error, Result},
    images::FloatImage,
};

/// Reads a PFM file with one channel, in either byte order.
///
/// As in the Middlebury tools, the sign of the scale gives the byte order, and its magnitude is ignored. Rows come from the
/// bottom, except in Photoshop's files, whose width and height have a line each.
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

/// Decodes the contents of the file `path`.
pub(super) fn decode_pfm(path: &Path, bytes: &[u8], limits: Limits) -> Result<FloatImage> {
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
