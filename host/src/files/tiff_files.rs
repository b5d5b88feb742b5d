//! Reading TIFF files, as machine vision and numerical tools write them.

use std::{io::Cursor, path::Path};

use image::{DynamicImage, ImageBuffer, metadata::Orientation};
use tiff::{
    ColorType, TiffError,
    decoder::{Decoder, DecodingResult},
    tags::Tag,
};

use super::{
    Limits,
    decoded::{Decoded, Numbers, damaged},
};
use crate::{
    error::{Error, Result},
    images::FloatImage,
};

/// A TIFF file of one picture that is not decoded yet.
pub(super) struct TiffFile<'a> {
    path: &'a Path,
    decoder: Decoder<Cursor<&'a [u8]>>,
}

impl<'a> TiffFile<'a> {
    /// Reads the header. Refuses raw photos, whose first picture is a preview, and files of several pictures.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], limits: Limits) -> Result<TiffFile<'a>> {
        const DNG_VERSION: Tag = Tag::Unknown(50706);
        let decoder = Decoder::new(Cursor::new(bytes)).map_err(|error| refused(path, &error))?;
        let mut tiff_limits = tiff::decoder::Limits::default();
        tiff_limits.decoding_buffer_size = usize::try_from(limits.max_picture_bytes()).unwrap_or(usize::MAX);
        tiff_limits.intermediate_buffer_size = tiff_limits.decoding_buffer_size;
        let mut file = TiffFile { path, decoder: decoder.with_limits(tiff_limits) };
        if file.is_preview() || file.tag::<u32>(DNG_VERSION).is_some() {
            let expected = "a picture: develop it to PNG or TIFF of 16 bits, for example with darktable";
            return Err(Error::format(path, "a raw photo, or the preview of another picture, as TIFF", expected));
        }
        let (width, height) = file.decoder.dimensions().map_err(|error| refused(path, &error))?;
        limits.check_size(path, width, height)?;
        while file.decoder.more_images() {
            if file.decoder.next_image().is_err() || !file.is_preview() {
                let expected = "one for each file: split it, for example with tiffsplit";
                return Err(Error::format(path, "several pictures in one TIFF file", expected));
            }
        }
        file.decoder.seek_to_image(0).map_err(|error| refused(path, &error))?;
        // Decoders may do without the end of compressed data, and without padding.
        let places = [(Tag::StripOffsets, Tag::StripByteCounts), (Tag::TileOffsets, Tag::TileByteCounts)];
        let ends = places.into_iter().flat_map(|(starts, lengths)| {
            let [starts, lengths] = [starts, lengths].map(|tag| file.tags::<u64>(tag).unwrap_or_default());
            starts.into_iter().zip(lengths).map(|(start, length)| start.saturating_add(length))
        });
        if ends.max() > Some(bytes.len() as u64) {
            return Err(damaged(path, "TIFF", &"data are missing"));
        }
        Ok(file)
    }

    /// Returns true if samples have 16 bits, without a word about which is white.
    pub(super) fn is_depth_unknown(&mut self) -> Result<bool> {
        use ColorType::{Gray, GrayA, RGB, RGBA};
        let color = self.decoder.colortype().map_err(|error| refused(self.path, &error))?;
        Ok(matches!(color, Gray(16) | GrayA(16) | RGB(16) | RGBA(16) | ColorType::Multiband { bit_depth: 16, num_samples: 2 }))
    }

    pub(super) fn decode(mut self) -> Result<Decoded> {
        use ColorType::{Gray, GrayA, Multiband, RGB, RGBA};
        let failed = |error: TiffError| refused(self.path, &error);
        let (width, height) = self.decoder.dimensions().map_err(failed)?;
        let color = self.decoder.colortype().map_err(failed)?;
        // Grey with an alpha channel is taken for two bands.
        let colors = match color {
            Gray(_) | GrayA(_) | Multiband { num_samples: 2, .. } => 1,
            RGB(8 | 16) | RGBA(8 | 16) => 3,
            _ => return Err(unsupported(self.path, &format_args!("of the kind {color:?}"))),
        };
        let mut samples = DecodingResult::U8(Vec::new());
        let layout = self.decoder.read_image_to_buffer(&mut samples).map_err(failed)?;
        let orientation = self.tag(Tag::Orientation).and_then(Orientation::from_exif);
        let pick = Pick { pixels: width as usize * height as usize, colors, is_planar: layout.planes > 1 };
        let image = match (color.bit_depth(), colors, samples) {
            (8, 1, DecodingResult::U8(samples)) => buffer(width, height, pick.of(&samples)).map(DynamicImage::ImageLuma8),
            (8, _, DecodingResult::U8(samples)) => buffer(width, height, pick.of(&samples)).map(DynamicImage::ImageRgb8),
            (16, 1, DecodingResult::U16(samples)) => buffer(width, height, pick.of(&samples)).map(DynamicImage::ImageLuma16),
            (16, _, DecodingResult::U16(samples)) => buffer(width, height, pick.of(&samples)).map(DynamicImage::ImageRgb16),
            (_, 1, samples) => {
                let (is_whole, values) = match samples {
                    DecodingResult::I16(samples) => (true, pick.of(&samples).into_iter().map(f32::from).collect()),
                    DecodingResult::F32(samples) => (false, pick.of(&samples)),
                    DecodingResult::F64(samples) => (false, pick.of(&samples).into_iter().map(|sample| sample as f32).collect()),
                    _ => return Err(unsupported(self.path, &format_args!("with samples of {} bits", color.bit_depth()))),
                };
                // Maps are not turned: they belong to pictures that are upright.
                return Ok(Decoded::Numbers(Numbers { map: FloatImage::new(width as usize, height as usize, values), is_whole }));
            }
            _ => None,
        };
        let mut image = image.ok_or_else(|| unsupported(self.path, &format_args!("of the kind {color:?}")))?;
        image.apply_orientation(orientation.unwrap_or(Orientation::NoTransforms));
        Ok(Decoded::Samples(image))
    }

    /// Returns true if the picture is a smaller version of another one.
    fn is_preview(&mut self) -> bool {
        self.tag::<u32>(Tag::NewSubfileType).is_some_and(|kind| kind & 1 == 1)
    }

    /// Returns the first number of a tag.
    fn tag<T: TryFrom<u64> + Copy>(&mut self, tag: Tag) -> Option<T> {
        self.tags(tag)?.first().copied()
    }

    /// Returns the numbers of a tag.
    fn tags<T: TryFrom<u64>>(&mut self, tag: Tag) -> Option<Vec<T>> {
        self.decoder.find_tag_unsigned_vec(tag).ok().flatten()
    }
}

/// The samples of decoded pixels that count.
struct Pick {
    pixels: usize,
    /// The channels that are taken. Those after them are dropped.
    colors: usize,
    /// Set if channels follow each other instead of pixels.
    is_planar: bool,
}

impl Pick {
    fn of<T: Copy>(&self, samples: &[T]) -> Vec<T> {
        let (pixels, colors) = (self.pixels, self.colors);
        let channels = samples.len() / pixels;
        let [pixel, channel] = if self.is_planar { [1, pixels] } else { [channels, 1] };
        (0..pixels * colors).filter_map(|i| samples.get(i / colors * pixel + i % colors * channel).copied()).collect()
    }
}

fn buffer<P: image::Pixel>(width: u32, height: u32, samples: Vec<P::Subpixel>) -> Option<ImageBuffer<P, Vec<P::Subpixel>>> {
    ImageBuffer::from_raw(width, height, samples)
}

fn refused(path: &Path, error: &TiffError) -> Error {
    match error {
        TiffError::UnsupportedError(error) => unsupported(path, &format_args!("that is not supported ({error})")),
        error => damaged(path, "TIFF", error),
    }
}

fn unsupported(path: &Path, what: &dyn std::fmt::Display) -> Error {
    let expected = "grey or RGB of 8 or 16 bits, uncompressed or by LZW, Deflate or PackBits: save it so, or as PNG";
    Error::format(path, format!("a TIFF image {what}"), expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{files::image_codec::CodedFile, images::Picture};

    /// An uncompressed TIFF of 2 x 3 pixels, after the specification (TIFF 6.0): the order of bytes, 42 and the place of the
    /// first directory; its number of entries; each entry's tag, type (3 is SHORT, 4 LONG), count and value; no next directory;
    /// the samples.
    fn tiff(is_big: bool, bits: u16, channels: u16, others: &[(u16, u32)], samples: &[u8]) -> Vec<u8> {
        let short = |value: u16| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
        let long = |value: u32| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
        let photometric = if channels > 2 { 2 } else { 1 };
        let mut entries = vec![(256, 2), (257, 3), (258, bits.into()), (259, 1), (262, photometric), (273, 0)];
        entries.extend([(277, channels.into()), (278, 3), (279, samples.len() as u32)]);
        entries.extend(others);
        entries.sort_unstable();
        let start = 8 + 2 + 12 * entries.len() as u32 + 4;
        // The bits of three channels do not fit in an entry.
        let has_more = channels > 2;
        let mut bytes = [if is_big { &b"MM"[..] } else { b"II" }, &short(42), &long(8), &short(entries.len() as u16)].concat();
        for (tag, value) in entries {
            let (kind, count, value) = match tag {
                258 if has_more => (short(3), channels.into(), long(start)),
                258 => (short(3), channels.into(), [short(bits); 2].as_flattened().try_into().unwrap()),
                274 | 338 | 339 => (short(3), 1, [short(value as u16), [0; 2]].as_flattened().try_into().unwrap()),
                273 => (short(4), 1, long(start + if has_more { 8 } else { 0 })),
                _ => (short(4), 1, long(value)),
            };
            bytes.extend([&short(tag)[..], &kind, &long(count), &value].concat());
        }
        bytes.extend(long(0));
        if has_more {
            bytes.extend([short(bits); 4].as_flattened());
        }
        [&bytes, samples].concat()
    }

    fn decoded(bytes: &[u8]) -> Result<Decoded> {
        CodedFile::new(Path::new("c.tif"), bytes, Limits::DEFAULT)?.decode()
    }

    fn picture(bytes: &[u8]) -> Picture {
        Picture::decode(Path::new("c.tif"), bytes).unwrap()
    }

    fn numbers(bytes: &[u8]) -> (Vec<f32>, bool) {
        match decoded(bytes).unwrap() {
            Decoded::Numbers(Numbers { map, is_whole }) => (map.pixels().to_vec(), is_whole),
            Decoded::Samples(image) => panic!("{:?}", image.color()),
        }
    }

    #[test]
    fn samples_are_read_in_both_orders_of_bytes() {
        let bytes: Vec<u8> = (0..18).collect();
        for is_big in [false, true] {
            assert_eq!(picture(&tiff(is_big, 8, 1, &[], &bytes[..6])).to_gray().as_raw(), &bytes[..6]);
            assert_eq!(picture(&tiff(is_big, 8, 3, &[], &bytes)).to_rgb().as_raw(), &bytes);
            let deep = [0, 1, 256, 700, 65534, 65535_u16];
            let coded = deep.map(|sample| if is_big { sample.to_be_bytes() } else { sample.to_le_bytes() });
            let Picture::Gray16(read) = picture(&tiff(is_big, 16, 1, &[], coded.as_flattened())) else { panic!("8 bits") };
            assert_eq!(read.as_raw(), &deep);
            let floats = [0.5, -2.0, f32::INFINITY, 1e9, 0.0, 3.25_f32];
            let coded = floats.map(|number| if is_big { number.to_be_bytes() } else { number.to_le_bytes() });
            assert_eq!(numbers(&tiff(is_big, 32, 1, &[(339, 3)], coded.as_flattened())), (floats.to_vec(), false));
            let coded = [-16, 0, 1, 160, 32767, -32768_i16];
            let bytes = coded.map(|number| if is_big { number.to_be_bytes() } else { number.to_le_bytes() });
            let expected = (coded.map(f32::from).to_vec(), true);
            assert_eq!(numbers(&tiff(is_big, 16, 1, &[(339, 2)], bytes.as_flattened())), expected);
        }
        // Alpha, and a picture whose first row is its right side.
        let alpha = picture(&tiff(false, 8, 2, &[(338, 2)], &bytes[..12]));
        assert_eq!(alpha.to_gray().as_raw(), &[0, 2, 4, 6, 8, 10]);
        let turned = picture(&tiff(true, 8, 1, &[(274, 6)], &bytes[..6]));
        assert_eq!((turned.dimensions(), turned.to_gray().as_raw()), ((3, 2), &vec![4, 2, 0, 5, 3, 1]));
    }

    #[test]
    fn what_is_no_picture_of_its_own_is_refused() {
        let gray = |others: &[(u16, u32)]| tiff(false, 8, 1, others, &[7; 6]);
        let refused = |bytes: &[u8]| decoded(bytes).err().expect("a refusal").to_string();
        for preview in [gray(&[(254, 1)]), gray(&[(50706, 0x401)])] {
            assert!(refused(&preview).contains("found a raw photo"), "{}", refused(&preview));
        }
        // The next directory is the first one again, of another picture.
        let mut pages = gray(&[]);
        let next = 8 + 2 + 12 * 9;
        let second = pages[8..].to_vec();
        let place = pages.len() as u32;
        pages[next..next + 4].copy_from_slice(&place.to_le_bytes());
        pages.extend(second);
        assert!(refused(&pages).contains("several pictures in one TIFF file"), "{}", refused(&pages));
        assert!(refused(&tiff(false, 32, 1, &[], &[0; 24])).contains("samples of 32 bits"));
    }

    #[test]
    fn every_truncation_is_an_error() {
        use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype::Gray8};
        let samples: Vec<u8> = (0..6).collect();
        let mut files = vec![tiff(false, 8, 1, &[], &samples), tiff(true, 32, 1, &[(339, 3)], &[0; 24])];
        for compression in [Compression::Lzw, Compression::Packbits, Compression::Deflate(DeflateLevel::Fast)] {
            let mut file = Cursor::new(Vec::new());
            let mut encoder = TiffEncoder::new(&mut file).unwrap().with_compression(compression);
            encoder.write_image::<Gray8>(2, 3, &samples).unwrap();
            assert_eq!(picture(file.get_ref()).to_gray().as_raw(), &samples);
            files.push(file.into_inner());
        }
        for file in files {
            assert!(decoded(&file).is_ok());
            for length in 0..file.len() {
                assert!(decoded(&file[..length]).is_err(), "{length} of {} bytes", file.len());
            }
        }
    }
}
