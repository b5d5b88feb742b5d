//! Reading files of pictures and maps, and writing PNG. Truncated and damaged files that decoders would accept are refused.

use std::{
    borrow::Cow,
    fmt::Display,
    io::{self, Cursor},
    path::Path,
};

use image::{
    DynamicImage, EncodableLayout, ImageBuffer, ImageDecoder, ImageError, ImageFormat, ImageReader, PixelWithColorType,
    codecs::png::PngEncoder, metadata::Orientation,
};

use super::{
    Limits,
    decoded::{Decoded, Numbers, damaged},
    file_kind::FileKind,
    jpeg_scans,
    netpbm::Netpbm,
    npy, output,
    pfm::decode_pfm,
    tiff_files::TiffFile,
};
use crate::{
    caught::caught,
    error::{Error, Result},
};

/// A file that is not decoded yet. Its contents decide the format, not the name.
pub(crate) struct CodedFile<'a> {
    path: &'a Path,
    /// The file as it is.
    bytes: &'a [u8],
    kind: FileKind,
    /// The file as its decoder takes it, and the header of a PGM, PPM or PAM.
    coded: (Cow<'a, [u8]>, Option<Netpbm>),
    limits: Limits,
}

impl<'a> CodedFile<'a> {
    /// Tells the format of the contents of the file `path`.
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8], limits: Limits) -> Result<CodedFile<'a>> {
        let kind = FileKind::of(path, bytes)?;
        let coded = match kind {
            FileKind::Image(ImageFormat::Png) => (without_metadata(bytes), None),
            FileKind::Image(ImageFormat::Jpeg) => (jpeg_scans::with_tables(bytes), None),
            FileKind::Image(ImageFormat::Pnm) => caught(|| Netpbm::read(bytes))
                .ok()
                .flatten()
                .map_or((bytes.into(), None), |(header, bytes)| (bytes, Some(header))),
            _ => (bytes.into(), None),
        };
        Ok(CodedFile { path, bytes, kind, coded, limits })
    }

    /// Returns true if the contents are samples of 16 bits without a word about which is white. PGM and PPM name the sample of
    /// white, and [`decode`](CodedFile::decode) scales it to 65535, but 65535 is also what programs write that do not know.
    pub(crate) fn is_depth_unknown(&self) -> Result<bool> {
        self.caught(|| match self.kind {
            FileKind::Image(format) => {
                let color = self.decoder(format, &self.coded.0)?.color_type();
                let has_16_bits = color.bytes_per_pixel() == 2 * color.channel_count();
                Ok(has_16_bits && self.coded.1.as_ref().is_none_or(|header| header.white == u32::from(u16::MAX)))
            }
            FileKind::Tiff => TiffFile::new(self.path, self.bytes, self.limits)?.is_depth_unknown(),
            FileKind::Pfm | FileKind::Npy | FileKind::Npz => Ok(false),
        })
    }

    /// Decodes the contents. A picture is turned as its EXIF orientation says.
    pub(crate) fn decode(&self) -> Result<Decoded> {
        self.caught(|| match self.kind {
            FileKind::Image(format) => self.image(format).map(Decoded::Samples),
            FileKind::Tiff => TiffFile::new(self.path, self.bytes, self.limits)?.decode(),
            FileKind::Pfm => {
                let map = decode_pfm(self.path, self.bytes, self.limits)?;
                Ok(Decoded::Numbers(Numbers { map, is_whole: false }))
            }
            FileKind::Npy => npy::decode(self.path, self.bytes, self.limits).map(Decoded::Numbers),
            FileKind::Npz => npy::decode_archive(self.path, self.bytes, self.limits).map(Decoded::Numbers),
        })
    }

    /// Does what needs a decoder, which may panic.
    fn caught<T>(&self, f: impl FnOnce() -> Result<T>) -> Result<T> {
        caught(f).unwrap_or_else(|message| Err(self.damaged(&format_args!("the decoder gave up: {message}"))))
    }

    fn image(&self, format: ImageFormat) -> Result<DynamicImage> {
        let (mut bytes, header) = (Cow::from(&*self.coded.0), &self.coded.1);
        let (width, height) = self.decoder(format, &bytes)?.dimensions();
        if is_truncated(format, &bytes, u64::from(width) * u64::from(height)) {
            return Err(self.damaged(&format_args!("data are missing for its {width}x{height} pixels")));
        }
        if let Some(header) = header {
            header.check(self.path, &bytes)?;
        }
        if format == ImageFormat::Jpeg {
            bytes = jpeg_scans::completed(&self.coded.0).map_err(|fault| self.damaged(&fault))?;
        }
        let mut decoder = self.decoder(format, &bytes)?;
        let orientation = self.orientation(format, &mut decoder);
        let mut image = DynamicImage::from_decoder(decoder).map_err(|error| self.damaged(&error))?;
        image.apply_orientation(orientation);
        Ok(image)
    }

    fn decoder<'b>(&self, format: ImageFormat, bytes: &'b [u8]) -> Result<impl ImageDecoder + use<'b>> {
        let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(self.limits.max_picture_bytes());
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|error| self.damaged(&error))?;
        let (width, height) = decoder.dimensions();
        self.limits.check_size(self.path, width, height)?;
        Ok(decoder)
    }

    /// Returns the turn that the picture needs. Damaged metadata say nothing.
    fn orientation(&self, format: ImageFormat, decoder: &mut impl ImageDecoder) -> Orientation {
        let exif = match format {
            // The decoder is not given metadata.
            ImageFormat::Png => png_chunks(self.bytes).find(|chunk| chunk.name == b"eXIf").map(|chunk| chunk.data.to_vec()),
            _ => decoder.exif_metadata().ok().flatten(),
        };
        exif.and_then(|exif| Orientation::from_exif_chunk(&exif)).unwrap_or(Orientation::NoTransforms)
    }

    fn damaged(&self, cause: &dyn Display) -> Error {
        let name = match self.kind {
            FileKind::Image(format) => format!("{format:?}").to_uppercase(),
            kind => format!("{kind:?}").to_uppercase(),
        };
        damaged(self.path, &name, cause)
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

/// Returns true if the end is missing, or the file is too short for that many pixels.
fn is_truncated(format: ImageFormat, bytes: &[u8], pixels: u64) -> bool {
    match format {
        ImageFormat::Png => !png_has_end(bytes),
        // Each block of 8x8 pixels takes at least one bit.
        ImageFormat::Jpeg => pixels > 8 * 64 * bytes.len() as u64,
        // The length of all that follows it.
        ImageFormat::WebP => bytes
            .get(4..8)
            .is_none_or(|length| bytes.len() - 8 < u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize),
        _ => false,
    }
}

fn png_has_end(bytes: &[u8]) -> bool {
    png_chunks(bytes).any(|chunk| chunk.name == b"IEND")
}
