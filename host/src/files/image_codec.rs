//! Reading and writing the formats of the `image` crate. Truncated files that the crate would accept are
//! refused.

use std::{
    io::{self, Cursor},
    path::Path,
};

use image::{
    DynamicImage, EncodableLayout, ImageBuffer, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits, PixelWithColorType,
    codecs::png::PngEncoder,
};

use crate::{
    error::{Error, Result},
    files::{input, output, truncation},
};

/// Decodes the contents of the file `path`. They decide the format, not the name.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Pnm | ImageFormat::Jpeg)) => format,
        other => {
            let found = other.map_or("an unknown kind of file".into(), |format| format!("a {format:?} image"));
            return Err(Error::format(path, found, "a PNG, PGM, PPM, JPEG or PFM image"));
        }
    };
    let damaged = |cause: &dyn std::fmt::Display| {
        let name = format!("{format:?}").to_uppercase();
        // Some decoders' messages have several lines.
        let cause = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        let found = format!("a damaged or truncated {name} image ({cause})");
        Error::format(path, found, "a complete one: copy or capture it again")
    };

    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(input::MAX_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| damaged(&error))?;
    let (width, height) = decoder.dimensions();
    input::check_size(path, width, height, decoder.total_bytes())?;
    if truncation::is_truncated(format, bytes, u64::from(width) * u64::from(height)) {
        return Err(damaged(&format_args!("data are missing for its {width}x{height} pixels")));
    }
    DynamicImage::from_decoder(decoder).map_err(|error| damaged(&error))
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
