//! Reading and writing the formats of the `image` crate. Truncated and damaged files that the crate would accept are refused.

use std::{
    borrow::Cow,
    io::{self, Cursor},
    path::Path,
};

use image::{
    DynamicImage, EncodableLayout, ImageBuffer, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits, PixelWithColorType,
    codecs::{png::PngEncoder, pnm::PnmDecoder},
    metadata::Orientation,
};

use crate::{
    error::{Error, Result},
    files::{input, jpeg_scans, output, panics, png_chunks, truncation},
};

/// Decodes the contents of the file `path`. They decide the format, not the name. The picture is turned as its EXIF orientation
/// says.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage> {
    let file = CodedFile::new(path, bytes)?;
    file.caught(|| file.image())
}

/// Whether the contents of the file `path` are samples of 16 bits without a word about which is white. PGM and PPM name the
/// sample of white, and [`decode`] scales it to 65535, but 65535 is also what programs write that do not know.
pub(crate) fn is_depth_unknown(path: &Path, bytes: &[u8]) -> Result<bool> {
    let file = CodedFile::new(path, bytes)?;
    file.caught(|| {
        let color = file.decoder()?.color_type();
        let has_16_bits = color.bytes_per_pixel() == 2 * color.channel_count();
        Ok(has_16_bits && (file.format != ImageFormat::Pnm || file.netpbm_white()? == u32::from(u16::MAX)))
    })
}

/// A file that is not decoded yet.
struct CodedFile<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    format: ImageFormat,
}

impl CodedFile<'_> {
    fn new<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<CodedFile<'a>> {
        match image::guess_format(bytes) {
            Ok(format @ (ImageFormat::Png | ImageFormat::Pnm | ImageFormat::Jpeg)) => Ok(CodedFile { path, bytes, format }),
            other => {
                let found = other.map_or("an unknown kind of file".into(), |format| format!("a {format:?} image"));
                Err(Error::format(path, found, "a PNG, PGM, PPM, JPEG or PFM image"))
            }
        }
    }

    /// Does what needs a decoder, which may panic.
    fn caught<T>(&self, f: impl FnOnce() -> Result<T>) -> Result<T> {
        panics::caught(f).unwrap_or_else(|message| Err(self.damaged(&format_args!("the decoder gave up: {message}"))))
    }

    fn image(&self) -> Result<DynamicImage> {
        let mut decoder = self.decoder()?;
        let (width, height) = decoder.dimensions();
        if truncation::is_truncated(self.format, self.bytes, u64::from(width) * u64::from(height)) {
            return Err(self.damaged(&format_args!("data are missing for its {width}x{height} pixels")));
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
            ImageFormat::Png => png_chunks::without_metadata(self.bytes),
            _ => Cow::from(self.bytes),
        };
        let mut reader = ImageReader::with_format(Cursor::new(bytes), self.format);
        let mut limits = Limits::default();
        limits.max_alloc = Some(input::max_picture_bytes());
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|error| self.damaged(&error))?;
        let (width, height) = decoder.dimensions();
        input::check_size(self.path, width, height)?;
        Ok(decoder)
    }

    /// How the picture is to be turned. Damaged metadata say nothing.
    fn orientation(&self, decoder: &mut impl ImageDecoder) -> Orientation {
        let exif = match self.format {
            // The decoder is not given metadata.
            ImageFormat::Png => {
                png_chunks::png_chunks(self.bytes).find(|chunk| chunk.name == b"eXIf").map(|chunk| chunk.data.to_vec())
            }
            _ => decoder.exif_metadata().ok().flatten(),
        };
        exif.and_then(|exif| Orientation::from_exif_chunk(&exif)).unwrap_or(Orientation::NoTransforms)
    }

    /// The sample of white in the header of a PGM or PPM.
    fn netpbm_white(&self) -> Result<u32> {
        let decoder = PnmDecoder::new(Cursor::new(self.bytes)).map_err(|error| self.damaged(&error))?;
        Ok(decoder.into_inner().1.maximal_sample())
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
