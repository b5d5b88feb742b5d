//! Reading pictures.

use std::path::Path;

use image::{DynamicImage, GrayImage, Luma, RgbImage};

use crate::{
    error::{Error, Result},
    files::{image_codec, input, pfm},
    images::{FloatImage, Picture},
};

impl Picture {
    /// Reads a PNG, PGM, PPM, JPEG or PFM file. The contents decide the format, not the name.
    ///
    /// 16-bit samples keep their high byte; a PGM or PPM with another maximum above 255 is scaled to 16 bits
    /// first. A PFM holds grey values from 0 to 1. Transparency and a JPEG's orientation tag are ignored.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if the file has another format, is truncated or damaged, or if
    /// the picture has a side of 0 or more than 65535 pixels, or more than 1 GiB.
    pub fn read(path: &Path) -> Result<Picture> {
        Picture::decode(path, &input::read(path)?)
    }

    pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<Picture> {
        if pfm::is_pfm(bytes) {
            return from_float(path, &pfm::decode(path, bytes)?);
        }
        Ok(match image_codec::decode(path, bytes)? {
            DynamicImage::ImageLuma8(gray) => Picture::Gray(gray),
            DynamicImage::ImageRgb8(rgb) => Picture::Rgb(rgb),
            other => without_alpha_and_low_bytes(&other),
        })
    }
}

/// Drops the alpha channel and the low bytes. The formats read give integer samples of 8 or 16 bits only.
fn without_alpha_and_low_bytes(image: &DynamicImage) -> Picture {
    let color = image.color();
    let samples = usize::from(color.channel_count());
    let kept = if color.has_color() { 3 } else { 1 };
    let sample_bytes = usize::from(color.bytes_per_pixel()) / samples;
    let high_byte = if cfg!(target_endian = "little") { sample_bytes - 1 } else { 0 };
    let pixels = image.as_bytes().chunks_exact(samples * sample_bytes);
    let bytes = pixels.flat_map(|pixel| pixel.chunks_exact(sample_bytes).take(kept).map(|sample| sample[high_byte])).collect();
    let (width, height) = (image.width(), image.height());
    let every_sample = "one byte for each sample";
    match kept {
        1 => Picture::Gray(GrayImage::from_raw(width, height, bytes).expect(every_sample)),
        _ => Picture::Rgb(RgbImage::from_raw(width, height, bytes).expect(every_sample)),
    }
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
mod tests {
    use super::*;
    use image::{ColorType, ImageBuffer, Rgb, Rgba, codecs::jpeg::JpegEncoder};
    use std::io::Cursor;

    fn decode(bytes: &[u8]) -> Result<Picture> {
        Picture::decode(Path::new("view.img"), bytes)
    }

    fn found(bytes: &[u8]) -> String {
        match decode(bytes) {
            Err(Error::Format { found, .. }) => found,
            other => panic!("{other:?}"),
        }
    }

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        let mut bytes = Vec::new();
        image.into().write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
        bytes
    }

    fn scene() -> RgbImage {
        RgbImage::from_fn(23, 9, |u, v| Rgb([(u * 11) as u8, (v * 28) as u8, (u * v) as u8]))
    }

    fn jpeg() -> Vec<u8> {
        let mut bytes = Vec::new();
        JpegEncoder::new(&mut bytes).encode_image(&scene()).unwrap();
        bytes
    }

    fn pfm() -> Vec<u8> {
        [&b"Pf\n3 2\n-1.0\n"[..], &[0.0f32, 0.25, 0.5, 0.75, 1.0, 0.1].map(f32::to_le_bytes).concat()].concat()
    }

    /// A small file of each kind, with its name.
    fn small_files() -> Vec<(&'static str, Vec<u8>)> {
        let netpbm = |header: &str, samples: usize| [header.as_bytes(), &vec![77; samples]].concat();
        vec![
            ("PNG grey", png(Picture::Rgb(scene()).to_gray())),
            ("PNG colour", png(scene())),
            ("JPEG", jpeg()),
            ("PGM", netpbm("P5\n# a comment\n4 3\n255\n", 12)),
            ("PGM of 16 bits", netpbm("P5 4 3 65535\n", 24)),
            ("PPM", netpbm("P6\n4 3\n255\n", 36)),
            ("PGM in text", b"P2\n3 2\n255\n0 1 2\n3 4 5".to_vec()),
            ("PPM in text", b"P3\n1 2\n255\n10 11 12\n13 14 5".to_vec()),
            ("PFM", pfm()),
        ]
    }

    #[test]
    fn reads_each_format() {
        assert_eq!(decode(&png(scene())).unwrap(), Picture::Rgb(scene()));
        let gray = Picture::Rgb(scene()).to_gray();
        assert_eq!(decode(&png(gray.clone())).unwrap(), Picture::Gray(gray));
        assert_eq!(decode(&jpeg()).unwrap().dimensions(), (23, 9));
        let gray = |w, h, bytes: &[u8]| Picture::Gray(GrayImage::from_raw(w, h, bytes.to_vec()).unwrap());
        assert_eq!(decode(b"P2\n# made by hand\n3 2\n255\n0 1 2\n3 4 5\n").unwrap(), gray(3, 2, &[0, 1, 2, 3, 4, 5]));
        assert_eq!(decode(b"P5 2 1 255\n\x07\x09").unwrap(), gray(2, 1, &[7, 9]));
        assert_eq!(decode(b"P6 1 1 255\n\x01\x02\x03").unwrap().color(0, 0), [1, 2, 3]);
        assert_eq!(decode(b"P3 1 1 255 1 2 3").unwrap().color(0, 0), [1, 2, 3]);
        // Rows are bottom-up in a PFM.
        assert_eq!(decode(&pfm()).unwrap(), gray(3, 2, &[191, 255, 26, 0, 64, 128]));
    }

    #[test]
    fn drops_the_low_byte_and_transparency() {
        let deep = ImageBuffer::from_raw(2, 1, vec![0x12FFu16, 0xFF00]).map(DynamicImage::ImageLuma16).unwrap();
        assert_eq!(decode(&png(deep)).unwrap().to_gray().as_raw(), &[0x12, 0xFF]);
        let deep = ImageBuffer::from_raw(1, 1, vec![0x1280u16, 0x34FF, 0x5600, 0x7800]).map(DynamicImage::ImageRgba16).unwrap();
        assert_eq!(deep.color(), ColorType::Rgba16);
        assert_eq!(decode(&png(deep)).unwrap().color(0, 0), [0x12, 0x34, 0x56]);
        assert_eq!(decode(&png(ImageBuffer::from_pixel(1, 1, Rgba([1u8, 2, 3, 0])))).unwrap().color(0, 0), [1, 2, 3]);
        assert_eq!(decode(b"P5 2 1 65535\n\x12\xFF\xFF\x00").unwrap().to_gray().as_raw(), &[0x12, 0xFF]);
        // 10 bits, as from machine vision cameras.
        assert_eq!(decode(b"P5 2 1 1023\n\x03\xFF\x02\x00").unwrap().to_gray().as_raw(), &[255, 128]);
    }

    #[test]
    fn the_contents_decide_the_format_and_errors_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("left.jpg");
        std::fs::write(&path, png(scene())).unwrap();
        assert_eq!(Picture::read(&path).unwrap().to_rgb(), scene());
        std::fs::write(&path, "#!/bin/sh\n").unwrap();
        let message = Picture::read(&path).unwrap_err().to_string();
        assert!(message.contains("left.jpg: found an unknown kind of file, expected a PNG, PGM"), "{message}");
        assert_eq!(found(b"GIF89a______________"), "a Gif image");
    }

    #[test]
    fn a_disparity_map_is_not_a_picture() {
        let map = [&b"Pf 1 1 -1\n"[..], &f32::INFINITY.to_le_bytes()].concat();
        assert!(found(&map).contains("the value inf"));
    }

    #[test]
    fn absurd_headers_are_refused() {
        for header in
            ["P5 0 0 255\n", "P5 0 7 255\n", "P5 65535 65535 255\n", "P5 4000000000 4000000000 255\n", "P6 70000 1 255\n"]
        {
            let size = found(header.as_bytes());
            assert!(size.starts_with("a picture of "), "{header} {size}");
        }
        assert!(found(b"P5 99999999999 1 255\n").contains("damaged"));
        assert!(found(b"P5 2 2 70000\n").contains("damaged"));

        // Another width and height in the header of a PNG, with a matching checksum.
        for (width, height) in [(65535u32, 65535u32), (4_000_000_000, 4_000_000_000), (0, 9), (23, 0), (70_000, 1)] {
            let mut bytes = png(scene());
            bytes[16..20].copy_from_slice(&width.to_be_bytes());
            bytes[20..24].copy_from_slice(&height.to_be_bytes());
            let checksum = crc32(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
            found(&bytes);
        }
    }

    /// The checksum of a PNG chunk.
    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
        })
    }

    #[test]
    fn every_truncation_is_an_error() {
        for (name, bytes) in small_files() {
            assert!(decode(&bytes).is_ok(), "{name}");
            for length in 0..bytes.len() {
                assert!(decode(&bytes[..length]).is_err(), "{name}: {length} of {} bytes are accepted", bytes.len());
            }
        }
    }

    #[test]
    fn no_damage_panics() {
        let mut state = 1u32;
        let mut random = move |below: usize| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as usize % below
        };
        for (_, bytes) in small_files() {
            for _ in 0..500 {
                let mut damaged = bytes.clone();
                for _ in 0..=random(3) {
                    // Half of the damage goes to the header, which matters most.
                    let end = if random(2) == 0 { bytes.len() } else { bytes.len().min(40) };
                    damaged[random(end)] = random(256) as u8;
                }
                let _ = decode(&damaged);
            }
        }
    }

    #[test]
    fn a_small_jpeg_file_cannot_hold_a_large_picture() {
        let mut bytes = jpeg();
        let frame = bytes.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
        bytes[frame + 5..frame + 9].fill(0xFE);
        let message = found(&bytes);
        assert!(message.contains("a picture of 65278x65278 pixels"), "{message}");
        bytes[frame + 5..frame + 9].copy_from_slice(&[0x10, 0, 0x10, 0]);
        assert!(found(&bytes).contains("data are missing for its 4096x4096 pixels"));
    }
}
