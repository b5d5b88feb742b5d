//! Reading and writing the formats of the `image` crate. Truncated and damaged files that the crate would accept are refused.

use std::{
    borrow::Cow,
    io::{self, Cursor},
    path::Path,
};

use image::{
    DynamicImage, EncodableLayout, ImageBuffer, ImageDecoder, ImageError, ImageFormat, ImageReader, PixelWithColorType,
    codecs::{
        png::PngEncoder,
        pnm::{PnmDecoder, PnmSubtype, SampleEncoding},
    },
    metadata::Orientation,
};

use super::jpeg_scans::codes::{END_OF_IMAGE, is_bare, next_marker, segment};
use crate::{
    caught::caught,
    error::{Error, Result},
    files::{Limits, jpeg_scans, output},
};

/// Decodes the contents of the file `path`. They decide the format, not the name. The picture is turned as its EXIF orientation
/// says.
pub(crate) fn decode(path: &Path, bytes: &[u8], limits: Limits) -> Result<DynamicImage> {
    let file = CodedFile::new(path, bytes, limits)?;
    file.caught(|| file.image())
}

/// Returns true if the contents of the file `path` are samples of 16 bits without a word about which is white. PGM and PPM name
/// the sample of white, and [`decode`] scales it to 65535, but 65535 is also what programs write that do not know.
pub(crate) fn is_depth_unknown(path: &Path, bytes: &[u8], limits: Limits) -> Result<bool> {
    let file = CodedFile::new(path, bytes, limits)?;
    file.caught(|| {
        let color = file.decoder()?.color_type();
        let has_16_bits = color.bytes_per_pixel() == 2 * color.channel_count();
        let white = || Netpbm::read(bytes).map(|netpbm| netpbm.white);
        Ok(has_16_bits && (file.format != ImageFormat::Pnm || white() == Some(u16::MAX.into())))
    })
}

/// A file that is not decoded yet.
struct CodedFile<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    format: ImageFormat,
    limits: Limits,
}

impl CodedFile<'_> {
    fn new<'a>(path: &'a Path, bytes: &'a [u8], limits: Limits) -> Result<CodedFile<'a>> {
        match image::guess_format(bytes) {
            Ok(format @ (ImageFormat::Png | ImageFormat::Pnm | ImageFormat::Jpeg)) => {
                Ok(CodedFile { path, bytes, format, limits })
            }
            other => {
                let found = other.map_or("an unknown kind of file".into(), |format| format!("a {format:?} image"));
                Err(Error::format(path, found, "a PNG, PGM, PPM, JPEG or PFM image"))
            }
        }
    }

    /// Does what needs a decoder, which may panic.
    fn caught<T>(&self, f: impl FnOnce() -> Result<T>) -> Result<T> {
        caught(f).unwrap_or_else(|message| Err(self.damaged(&format_args!("the decoder gave up: {message}"))))
    }

    fn image(&self) -> Result<DynamicImage> {
        let mut decoder = self.decoder()?;
        let (width, height) = decoder.dimensions();
        if is_truncated(self.format, self.bytes, u64::from(width) * u64::from(height)) {
            return Err(self.damaged(&format_args!("data are missing for its {width}x{height} pixels")));
        }
        if let Some(netpbm) = Netpbm::read(self.bytes).filter(|_| self.format == ImageFormat::Pnm) {
            netpbm.check(self.path)?;
        }
        let orientation = self.orientation(&mut decoder);
        let mut image = DynamicImage::from_decoder(decoder).map_err(|error| self.damaged(&error))?;
        if self.format == ImageFormat::Jpeg {
            jpeg_scans::check(self.bytes).map_err(|fault| self.damaged(&fault))?;
        }
        image.apply_orientation(orientation);
        Ok(image)
    }

    fn decoder(&self) -> Result<impl ImageDecoder> {
        let bytes = match self.format {
            ImageFormat::Png => without_metadata(self.bytes),
            ImageFormat::Pnm => Netpbm::read(self.bytes).map_or(self.bytes.into(), |netpbm| netpbm.bytes),
            _ => Cow::from(self.bytes),
        };
        let mut reader = ImageReader::with_format(Cursor::new(bytes), self.format);
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(self.limits.max_picture_bytes());
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|error| self.damaged(&error))?;
        let (width, height) = decoder.dimensions();
        self.limits.check_size(self.path, width, height)?;
        Ok(decoder)
    }

    /// Returns the turn that the picture needs. Damaged metadata say nothing.
    fn orientation(&self, decoder: &mut impl ImageDecoder) -> Orientation {
        let exif = match self.format {
            // The decoder is not given metadata.
            ImageFormat::Png => png_chunks(self.bytes).find(|chunk| chunk.name == b"eXIf").map(|chunk| chunk.data.to_vec()),
            _ => decoder.exif_metadata().ok().flatten(),
        };
        exif.and_then(|exif| Orientation::from_exif_chunk(&exif)).unwrap_or(Orientation::NoTransforms)
    }

    fn damaged(&self, cause: &dyn std::fmt::Display) -> Error {
        let name = format!("{:?}", self.format).to_uppercase();
        // Some decoders' messages have several lines.
        let cause = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        let found = format!("a damaged or truncated {name} image ({cause})");
        Error::format(self.path, found, "a complete one: copy or capture it again")
    }
}

/// Writes `image` as a PNG file.
///
/// # Errors
/// [`Error::Write`]. Any previous version of the file is unchanged.
pub fn write_png<P>(path: &Path, image: &ImageBuffer<P, Vec<P::Subpixel>>) -> Result<()>
where
    P: PixelWithColorType,
    [P::Subpixel]: EncodableLayout,
{
    output::write(path, |writer| {
        image.write_with_encoder(PngEncoder::new(writer)).map_err(|error| match error {
            ImageError::IoError(error) => error,
            error => io::Error::other(error),
        })
    })
}

/// A PGM, PPM or PAM file.
struct Netpbm<'a> {
    /// The sample of white.
    white: u32,
    encoding: SampleEncoding,
    /// Bytes of a binary sample.
    sample_bytes: usize,
    /// The number of samples.
    samples: usize,
    /// Length of the header.
    start: usize,
    /// The file, its header ended by a single character.
    bytes: Cow<'a, [u8]>,
}

impl Netpbm<'_> {
    /// Reads the header. `None` if that is damaged.
    fn read(bytes: &[u8]) -> Option<Netpbm<'_>> {
        let decoder = PnmDecoder::new(Cursor::new(bytes)).ok()?;
        let total = usize::try_from(decoder.total_bytes()).ok()?;
        let color = decoder.color_type();
        let sample_bytes = usize::from(color.bytes_per_pixel() / color.channel_count());
        let (cursor, header) = decoder.into_inner();
        let (white, encoding, start) = (header.maximal_sample(), header.subtype().sample_encoding(), cursor.position() as usize);
        // Programs in text mode end the header with CR LF, and the decoder takes LF for a sample: the file has one too many.
        let is_crlf = start > 0 && bytes.get(start - 1..=start) == Some(b"\r\n");
        let bytes = match is_crlf && matches!(header.subtype(), PnmSubtype::Graymap(_) | PnmSubtype::Pixmap(_)) {
            true if bytes.len() - start > total => [&bytes[..start], &bytes[start + 1..]].concat().into(),
            _ => bytes.into(),
        };
        Some(Netpbm { white, encoding, sample_bytes, samples: total / sample_bytes, start, bytes })
    }

    /// Checks that no sample is above white. The decoder scales them nevertheless.
    fn check(&self, path: &Path) -> Result<()> {
        let data = self.bytes.get(self.start..).unwrap_or_default();
        let brightest = match (self.encoding, self.sample_bytes) {
            (SampleEncoding::Ascii, _) => {
                let words = data.split(u8::is_ascii_whitespace).filter_map(|word| str::from_utf8(word).ok()?.parse::<u32>().ok());
                words.take(self.samples).max()
            }
            (SampleEncoding::Binary, 2) => {
                data.as_chunks().0.iter().take(self.samples).map(|&bytes| u16::from_be_bytes(bytes).into()).max()
            }
            (SampleEncoding::Binary, _) => data.iter().take(self.samples).map(|&sample| sample.into()).max(),
        };
        match brightest {
            // Bits have no maximum: theirs is what the decoder makes of them.
            Some(brightest) if brightest > self.white && self.white > 1 => Err(Error::format(
                path,
                format!("a sample of {brightest} where the header's maximum is {}", self.white),
                "none above it, the more significant byte of each first",
            )),
            _ => Ok(()),
        }
    }
}

const SIGNATURE_BYTES: usize = 8;

/// A chunk: length, name, data and checksum.
struct PngChunk<'a> {
    name: &'a [u8; 4],
    data: &'a [u8],
    /// All of its bytes.
    whole: &'a [u8],
}

impl PngChunk<'_> {
    /// Returns true if the pixels depend on it. The others hold colour profiles, texts and animations.
    fn is_critical(&self) -> bool {
        self.name[0].is_ascii_uppercase()
    }
}

/// The chunks of a PNG file, up to the first that is incomplete.
fn png_chunks(bytes: &[u8]) -> impl Iterator<Item = PngChunk<'_>> {
    let mut rest = bytes.get(SIGNATURE_BYTES..).unwrap_or_default();
    std::iter::from_fn(move || {
        let start = rest;
        let (length, data) = rest.split_first_chunk()?;
        let (name, data) = data.split_first_chunk()?;
        let length = u32::from_be_bytes(*length) as usize;
        rest = data.get(length.checked_add(4)?..)?;
        Some(PngChunk { name, data: &data[..length], whole: &start[..start.len() - rest.len()] })
    })
}

/// A PNG file without the chunks that its pixels do not depend on. The decoder would inflate a colour profile, to a thousand
/// times its size.
fn without_metadata(bytes: &[u8]) -> Cow<'_, [u8]> {
    if png_chunks(bytes).all(|chunk| chunk.is_critical()) {
        return bytes.into();
    }
    let signature = &bytes[..SIGNATURE_BYTES.min(bytes.len())];
    let critical = png_chunks(bytes).filter(PngChunk::is_critical).map(|chunk| chunk.whole);
    [signature].into_iter().chain(critical).collect::<Vec<_>>().concat().into()
}

/// Returns true if the end marker is missing, or the file is too short for that many pixels.
fn is_truncated(format: ImageFormat, bytes: &[u8], pixels: u64) -> bool {
    match format {
        ImageFormat::Png => !png_has_end(bytes),
        // Each block of 8x8 pixels takes at least one bit.
        ImageFormat::Jpeg => !jpeg_has_end(bytes) || pixels > 8 * 64 * bytes.len() as u64,
        _ => false,
    }
}

fn png_has_end(bytes: &[u8]) -> bool {
    png_chunks(bytes).any(|chunk| chunk.name == b"IEND")
}

/// Follows the segments, and the coded data between them, to the marker at the end.
fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    while let Some((marker, after)) = next_marker(rest) {
        rest = match (marker, segment(after)) {
            (END_OF_IMAGE, _) => return true,
            (marker, _) if is_bare(marker) => after,
            (_, Some((_, after))) => after,
            (_, None) => return false,
        };
    }
    false
}
