//! Image files as the `image` crate knows them, checked for what it lets pass.

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
    files::{input, output},
};

/// Decodes the contents of `path`; what kind of file it is, the contents say, not the name.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Pnm | ImageFormat::Jpeg)) => format,
        other => {
            let found = other.map_or("an unknown kind of file".into(), |format| format!("a {format:?} image"));
            return Err(Error::format(path, found, "a PNG, PGM, PPM, JPEG or PFM image"));
        }
    };
    let damaged = |what: &dyn std::fmt::Display| {
        let name = format!("{format:?}").to_uppercase();
        // Some of the decoders' messages have lines.
        let what = what.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        Error::format(path, format!("a damaged or truncated {name} image ({what})"), "a complete one: copy or capture it again")
    };

    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(input::MAX_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| damaged(&error))?;
    let (width, height) = decoder.dimensions();
    input::check_size(path, width, height, decoder.total_bytes())?;
    if !is_complete(format, bytes, u64::from(width) * u64::from(height)) {
        return Err(damaged(&format_args!("data are missing for its {width}x{height} pixels")));
    }
    DynamicImage::from_decoder(decoder).map_err(|error| damaged(&error))
}

/// Writes `image` as a PNG.
///
/// # Errors
/// If the file cannot be written; what was there before is still there.
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

/// Whether the file has its end mark and may hold so many pixels. The decoder fills with grey what is missing from a JPEG, and says
/// nothing.
fn is_complete(format: ImageFormat, bytes: &[u8], pixels: u64) -> bool {
    match format {
        ImageFormat::Png => png_reaches_its_end(bytes),
        // A block of 8x8 pixels takes a bit at least.
        ImageFormat::Jpeg => jpeg_reaches_its_end(bytes) && pixels <= 8 * 64 * bytes.len() as u64,
        _ => true,
    }
}

/// Follows the chunks (length, name, data, checksum) to the one named IEND.
fn png_reaches_its_end(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((&[a, b, c, d, ref name @ ..], data)) = rest.split_first_chunk::<8>() {
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        rest = match data.get(length + 4..) {
            Some(_) if name == b"IEND" => return true,
            Some(next) => next,
            None => return false,
        };
    }
    false
}

/// Follows the segments (0xFF, marker, length, data) and the coded data between them to the marker EOI.
fn jpeg_reaches_its_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    while let Some(&[first, marker]) = rest.first_chunk() {
        let skip = match (first, marker) {
            (0xFF, 0xD9) => return true,
            // Fill before a marker.
            (0xFF, 0xFF) => 1,
            // An escaped 0xFF, a restart, the start: markers without data.
            (0xFF, 0x00 | 0x01 | 0xD0..=0xD8) => 2,
            (0xFF, _) => match rest.get(2..4) {
                Some(length) => 2 + usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
            _ => 1,
        };
        rest = rest.get(skip..).unwrap_or_default();
    }
    false
}
