//! Reading and writing pictures.

use std::path::Path;

use image::{DynamicImage, GrayImage, Luma};
use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    files::{
        Limits,
        decoded::Decoded,
        image_codec::{self, CodedFile},
    },
    images::{BitDepth, FloatImage, Picture},
};

impl Picture {
    /// Reads a PNG, JPEG, TIFF, BMP, WebP, PGM, PPM or PFM file. The contents decide the format, not the name.
    ///
    /// 16-bit samples are scaled so that white is 65535, rounded to nearest. White is the maximum that a PGM or PPM names, or
    /// else the largest number of [`BitDepth::of_brightest`] bits of this picture: read the pictures of one capture with
    /// [`Picture::read_within`]. A PFM, or a TIFF of real numbers, holds grey values from 0 to 1, which are rounded to 8 bits.
    /// The picture is turned as its EXIF orientation says, and transparency is dropped.
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
            let file = CodedFile::new(path, &bytes, limits)?;
            match file.is_depth_unknown()? {
                true => Ok(Some(brightest_of(&picture_of(path, file.decode()?)?))),
                false => Ok(None),
            }
        };
        // All are waited for, so that the error is always that of the first file.
        let found: Vec<Result<Option<u16>>> = paths.par_iter().map(brightest).collect();
        found.into_iter().try_fold(None, |brightest, found| Ok(brightest.max(found?)))
    }

    /// Decodes the bytes of a file of this path, or of a camera's frame.
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
    let file = CodedFile::new(path, bytes, limits)?;
    let mut picture = picture_of(path, file.decode()?)?;
    if picture.has_16_bits() && file.is_depth_unknown()? {
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

fn picture_of(path: &Path, decoded: Decoded) -> Result<Picture> {
    match decoded {
        Decoded::Samples(image) => Ok(without_alpha(image)),
        Decoded::Numbers(numbers) => from_float(path, &numbers.map),
    }
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
            format!("a map with the value {value} (is it of disparities or depths?)"),
            "an image, with values from 0 to 1",
        ));
    }
    let gray = |u, v| Luma([(255.0 * image.get(u as usize, v as usize)).round() as u8]);
    Ok(Picture::Gray(GrayImage::from_fn(image.width() as u32, image.height() as u32, gray)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ColorType, ImageBuffer, ImageFormat, Rgb, RgbImage, Rgba, codecs::jpeg::JpegEncoder};
    use std::io::Cursor;

    fn decode(bytes: &[u8]) -> Result<Picture> {
        Picture::decode(Path::new("view.img"), bytes)
    }

    fn found(bytes: &[u8]) -> String {
        match decode(bytes) {
            Err(Error::Format { found, .. }) => found,
            Err(error @ Error::PictureSize { .. }) => error.to_string().replace("view.img: found ", ""),
            other => panic!("{other:?}"),
        }
    }

    fn coded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Vec::new();
        image.into().write_to(&mut Cursor::new(&mut bytes), format).unwrap();
        bytes
    }

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        coded(image, ImageFormat::Png)
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
            ("BMP grey", coded(Picture::Rgb(scene()).to_gray(), ImageFormat::Bmp)),
            ("BMP colour", coded(scene(), ImageFormat::Bmp)),
            ("WebP", coded(scene(), ImageFormat::WebP)),
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
        for format in [ImageFormat::Bmp, ImageFormat::WebP] {
            assert_eq!(decode(&coded(scene(), format)).unwrap(), Picture::Rgb(scene()), "{format:?}");
            assert_eq!(
                decode(&coded(Picture::Rgb(scene()).to_gray(), format)).unwrap().to_gray(),
                Picture::Rgb(scene()).to_gray()
            );
        }
        let gray = |w, h, bytes: &[u8]| Picture::Gray(GrayImage::from_raw(w, h, bytes.to_vec()).unwrap());
        assert_eq!(decode(b"P2\n# made by hand\n3 2\n255\n0 1 2\n3 4 5\n").unwrap(), gray(3, 2, &[0, 1, 2, 3, 4, 5]));
        assert_eq!(decode(b"P5 2 1 255\n\x07\x09").unwrap(), gray(2, 1, &[7, 9]));
        // The header may end with CR LF. LF by itself is a sample after CR.
        assert_eq!(decode(b"P5\r\n2 1\r\n255\r\n\x07\x09").unwrap(), gray(2, 1, &[7, 9]));
        assert_eq!(decode(b"P5 2 1 255\r\n\x09").unwrap(), gray(2, 1, &[10, 9]));
        assert_eq!(decode(b"P6 1 1 255\n\x01\x02\x03").unwrap().color(0, 0), [1, 2, 3]);
        assert_eq!(decode(b"P3 1 1 255 1 2 3").unwrap().color(0, 0), [1, 2, 3]);
        // Rows are bottom-up in a PFM.
        assert_eq!(decode(&pfm()).unwrap(), gray(3, 2, &[191, 255, 26, 0, 64, 128]));
    }

    #[test]
    fn drops_transparency() {
        let deep = ImageBuffer::from_raw(1, 1, vec![0x1280u16, 0x34FF, 0x5600, 0x7800]).map(DynamicImage::ImageRgba16).unwrap();
        assert_eq!(deep.color(), ColorType::Rgba16);
        let colour = |samples: Vec<u16>| ImageBuffer::from_raw(1, 1, samples).map(Picture::Rgb16).unwrap();
        assert_eq!(decode(&png(deep)).unwrap(), colour(vec![0x1280, 0x34FF, 0x5600]));
        assert_eq!(decode(&png(ImageBuffer::from_pixel(1, 1, Rgba([1u8, 2, 3, 0])))).unwrap().color(0, 0), [1, 2, 3]);
        // Opaque pixels are no bright samples.
        let dark = ImageBuffer::from_pixel(1, 1, image::LumaA([1023u16, 65535]));
        assert_eq!(decode(&png(dark)).unwrap().color(0, 0), [255; 3]);
    }

    fn deep_png(samples: &[u16]) -> Vec<u8> {
        png(ImageBuffer::from_raw(samples.len() as u32, 1, samples.to_vec()).map(DynamicImage::ImageLuma16).unwrap())
    }

    /// The samples of a grey picture of 16 bits.
    fn deep(picture: Result<Picture>) -> Vec<u16> {
        match picture.unwrap() {
            Picture::Gray16(gray) => gray.into_raw(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn sixteen_bits_are_read_by_their_depth() {
        for (brightest, depth) in [(1023, BitDepth::Ten), (4095, BitDepth::Twelve), (16383, BitDepth::Fourteen)] {
            let samples = [brightest, 100, 0];
            let expected = samples.map(|sample| (f64::from(sample) * 65535.0 / f64::from(brightest)).round() as u16);
            for depth in [None, Some(depth)] {
                assert_eq!(deep(super::decode(Path::new("p"), &deep_png(&samples), depth, Limits::DEFAULT)), expected);
            }
            assert_eq!(
                deep(super::decode(Path::new("p"), &deep_png(&samples), Some(BitDepth::Sixteen), Limits::DEFAULT)),
                samples
            );
            let brighter = deep_png(&[7, brightest + 1]);
            let message = super::decode(Path::new("p.png"), &brighter, Some(depth), Limits::DEFAULT).unwrap_err().to_string();
            let (found, bits) = (brightest + 1, depth.bits());
            let expected = format!("p.png: found a sample of {found}, expected at most {brightest}, the maximum of {bits} bits");
            assert_eq!(message, expected);
        }
        assert_eq!(deep(decode(&deep_png(&[0x12FF, 0xFF00]))), [0x12FF, 0xFF00]);
        assert_eq!(deep(decode(b"P5 2 1 65535\n\x03\xFF\x00\x00")), [65535, 0]);
        // A header that names the maximum is believed, whatever the depth and however dark the picture is.
        for depth in [None, Some(BitDepth::Ten)] {
            let named = super::decode(Path::new("p"), b"P5 2 1 4095\n\x01\x00\x02\x00", depth, Limits::DEFAULT);
            assert_eq!(deep(named), [4097, 8194]);
        }
    }

    #[test]
    fn samples_above_the_maximum_of_the_header_are_refused() {
        let message = |bytes: &[u8]| decode(bytes).unwrap_err().to_string();
        // The bytes of 1023 and 2 in the wrong order.
        let found = message(b"P5 2 1 1023\n\xFF\x03\x02\x00");
        assert!(found.contains("a sample of 65283 where the header's maximum is 1023"), "{found}");
        assert!(message(b"P5 2 1 100\n\x64\x65").contains("a sample of 101 "));
        assert!(message(b"P3 1 1 100\n100 7 300\n").contains("a sample of 300 "));
        // What follows the picture does not matter.
        assert_eq!(decode(b"P5 2 1 100\n\x00\x64\xFF").unwrap(), Picture::Gray(GrayImage::from_raw(2, 1, vec![0, 255]).unwrap()));
        assert_eq!(deep(decode(b"P5 2 1 1023\n\x03\xFF\x00\x00")), [65535, 0]);
    }

    #[test]
    fn the_brightest_sample_of_all_files_counts() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            std::fs::write(dir.path().join(name), bytes).unwrap();
            dir.path().join(name)
        };
        let (dark, bright) = (file("a.png", &deep_png(&[9, 4])), file("b.pgm", b"P5 1 1 65535\n\x0F\x00"));
        let others = [file("c.pgm", b"P5 1 1 60000\n\x80\x00"), file("d.png", &png(scene())), file("e.pfm", &pfm())];
        let mut all: Vec<&Path> = others.iter().map(std::path::PathBuf::as_path).collect();
        assert_eq!(Picture::brightest(&all, Limits::DEFAULT).unwrap(), None);
        all.extend([&*dark, &*bright]);
        assert_eq!(Picture::brightest(&all, Limits::DEFAULT).unwrap(), Some(0x0F00));
        let damaged = file("f.png", &deep_png(&[1, 2])[..40]);
        let none = dir.path().join("g.png");
        let message = Picture::brightest(&[&dark, &damaged, &none], Limits::DEFAULT).unwrap_err().to_string();
        assert!(message.contains("f.png"), "{message}");
    }

    #[test]
    fn writes_what_it_reads() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.png");
        let samples: Vec<u16> = (0..36).map(|k| 1820 * k).collect();
        let rgb = ImageBuffer::from_raw(4, 3, samples.clone()).map(Picture::Rgb16).unwrap();
        let gray = ImageBuffer::from_raw(6, 6, samples).map(Picture::Gray16).unwrap();
        for picture in [rgb.clone().into_8_bits(), gray.clone().into_8_bits(), rgb, gray] {
            picture.write_png(&path).unwrap();
            assert_eq!(Picture::read_within(&path, Some(BitDepth::Sixteen), Limits::DEFAULT).unwrap(), picture);
        }
    }

    /// EXIF data with one entry, the orientation, after the TIFF header of the EXIF specification (CIPA DC-008, 4.5.2): the order
    /// of bytes, 42, the place of the first directory; its number of entries; tag 0x0112 of type 3 (SHORT) and length 1; and no
    /// next directory.
    fn exif(orientation: u16, big_endian: bool) -> Vec<u8> {
        let short = |value: u16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let long = |value: u32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let order = if big_endian { b"MM" } else { b"II" };
        let header = [&order[..], &short(42), &long(8), &short(1)].concat();
        [&header[..], &short(0x0112), &short(3), &long(1), &short(orientation), &[0, 0], &long(0)].concat()
    }

    /// A PNG with an eXIf chunk after its header, or before its end.
    fn tagged_png(png: &[u8], exif: &[u8], at_end: bool) -> Vec<u8> {
        let named = [b"eXIf", exif].concat();
        let chunk = [&(exif.len() as u32).to_be_bytes(), &named[..], &crc32fast::hash(&named).to_be_bytes()].concat();
        // The signature and the header have 33 bytes, the end has 12.
        let (before, after) = png.split_at(if at_end { png.len() - 12 } else { 33 });
        [before, &chunk, after].concat()
    }

    /// A JPEG with an APP1 segment after its start.
    fn tagged_jpeg(jpeg: &[u8], exif: &[u8]) -> Vec<u8> {
        let length = (exif.len() as u16 + 8).to_be_bytes();
        [&jpeg[..2], b"\xFF\xE1", &length, b"Exif\0\0", exif, &jpeg[2..]].concat()
    }

    /// Returns the place at which pixel `(u, v)` of an upright picture of `w` x `h` pixels is stored: orientation 6, say, has the
    /// upright picture's right column in its first row, and its top row in its first column.
    fn stored_at(orientation: u16, [w, h]: [u32; 2], [u, v]: [u32; 2]) -> [u32; 2] {
        match orientation {
            2 => [w - 1 - u, v],
            3 => [w - 1 - u, h - 1 - v],
            4 => [u, h - 1 - v],
            5 => [v, u],
            6 => [v, w - 1 - u],
            7 => [h - 1 - v, w - 1 - u],
            8 => [h - 1 - v, u],
            _ => [u, v],
        }
    }

    #[test]
    fn exif_orientations_are_obeyed() {
        let stored = decode(&jpeg()).unwrap();
        // PNG and JPEG of the same pixels.
        let files = [png(stored.to_rgb()), jpeg()];
        for orientation in 0..=9 {
            let (w, h) = if (5..=8).contains(&orientation) { (9, 23) } else { (23, 9) };
            let upright = RgbImage::from_fn(w, h, |u, v| {
                let [u, v] = stored_at(orientation, [w, h], [u, v]);
                Rgb(stored.color(u, v))
            });
            for big_endian in [false, true] {
                let exif = exif(orientation, big_endian);
                let [png, jpeg] = &files;
                for file in [tagged_png(png, &exif, false), tagged_png(png, &exif, true), tagged_jpeg(jpeg, &exif)] {
                    assert_eq!(decode(&file).unwrap().to_rgb(), upright, "orientation {orientation}");
                }
            }
        }
        // 16 bits are turned as well, and damaged metadata say nothing.
        let exif = exif(8, true);
        let tagged = |exif: &[u8]| deep(decode(&tagged_png(&deep_png(&[40000, 2, 3]), exif, false)));
        assert_eq!((tagged(&exif), tagged(&exif[..14])), (vec![3, 2, 40000], vec![40000, 2, 3]));
    }

    #[test]
    fn the_contents_decide_the_format_and_errors_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("left.jpg");
        std::fs::write(&path, png(scene())).unwrap();
        assert_eq!(Picture::read(&path).unwrap().to_rgb(), scene());
        std::fs::write(&path, "#!/bin/sh\n").unwrap();
        let message = Picture::read(&path).unwrap_err().to_string();
        assert!(message.contains("left.jpg: found an unknown kind of file, expected a PNG, JPEG, TIFF"), "{message}");
        assert_eq!(found(b"GIF89a______________"), "a GIF image");
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
            let checksum = crc32fast::hash(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
            found(&bytes);
        }
    }

    #[test]
    fn every_truncation_is_an_error() {
        for (name, bytes) in small_files() {
            assert!(decode(&bytes).is_ok(), "{name}");
            // The end marker of a JPEG alone may be missing.
            let needed = if name == "JPEG" { bytes.len() - 2 } else { bytes.len() };
            for length in 0..needed {
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
