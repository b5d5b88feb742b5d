//! The kinds of files, by their contents: those that are read as pictures or maps, and others, which are refused by name.

use std::path::Path;

use image::ImageFormat;

use crate::error::{Error, Result};

/// The formats of pictures, as messages name them.
pub(super) const PICTURES: &str = "a PNG, JPEG, TIFF, BMP, WebP, PGM, PPM or PFM image";

/// A file that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FileKind {
    /// A picture that crate `image` decodes.
    Image(ImageFormat),
    Tiff,
    Pfm,
    Npy,
    Npz,
}

/// The first bytes of files, and what they are. Those of TIFF begin raw photos, too.
const READ: [(&[u8], FileKind); 8] = [
    (b"II*\0", FileKind::Tiff),
    (b"MM\0*", FileKind::Tiff),
    (b"II+\0", FileKind::Tiff),
    (b"MM\0+", FileKind::Tiff),
    (b"Pf", FileKind::Pfm),
    (b"PF", FileKind::Pfm),
    (b"\x93NUMPY", FileKind::Npy),
    (b"PK\x03\x04", FileKind::Npz),
];

/// Pictures that are not read: where bytes tell them, which ones, and their names.
const OTHERS: [(usize, &[u8], &str); 25] = [
    (4, b"ftypavi", "an AVIF image"),
    (4, b"ftypcrx ", "a CR3 raw photo"),
    (4, b"ftyphe", "a HEIC image"),
    (4, b"ftypmif1", "a HEIC image"),
    (4, b"ftypmsf1", "a HEIC image"),
    (4, b"ftyp", "a video"),
    (8, b"CR\x02\0", "a CR2 raw photo"),
    (0, b"FUJIFILMCCD-RAW", "a RAF raw photo"),
    (0, b"IIRO", "an ORF raw photo"),
    (0, b"IIRS", "an ORF raw photo"),
    (0, b"IIU\0", "an RW2 raw photo"),
    (0, b"\0MRM", "an MRW raw photo"),
    (0, b"FOVb", "an X3F raw photo"),
    (0, b"GIF8", "a GIF image"),
    (4, b"jP  \r\n", "a JPEG 2000 image"),
    (0, b"\xFF\x4F\xFF\x51", "a JPEG 2000 image"),
    (0, b"\xFF\x0A", "a JPEG XL image"),
    (4, b"JXL \r\n", "a JPEG XL image"),
    (0, b"\x76\x2F\x31\x01", "an OpenEXR image"),
    (0, b"#?RADIANCE", "a Radiance HDR image"),
    (0, b"8BPS", "a Photoshop document"),
    (0, b"DDS ", "a DDS image"),
    (0, b"\0\0\x01\0", "an icon"),
    (0, b"qoif", "a QOI image"),
    (0, b"%PDF", "a PDF document"),
];

impl FileKind {
    /// Returns the kind of the contents of the file `path`, of which the name does not matter.
    ///
    /// # Errors
    /// [`Error::Format`], with the name of the kind, if files of it are not read as pictures or maps.
    pub(super) fn of(path: &Path, bytes: &[u8]) -> Result<FileKind> {
        let starts = |at: usize, magic: &[u8]| bytes.get(at..).is_some_and(|bytes| bytes.starts_with(magic));
        if let Some((_, _, name)) = OTHERS.iter().find(|(at, magic, _)| starts(*at, magic)) {
            // AVIF may be the second brand of a file.
            let is_avif = name.contains("HEIC") && bytes[..bytes.len().min(64)].windows(4).any(|brand| brand == b"avif");
            let advice = match name.contains("raw photo") {
                true => "develop it to PNG or TIFF of 16 bits, for example with darktable",
                false => "convert it to PNG, for example with ImageMagick",
            };
            return Err(Error::format(path, if is_avif { "an AVIF image" } else { name }, format!("{PICTURES}: {advice}")));
        }
        let read = READ.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, kind)| *kind);
        match read.or_else(|| image::guess_format(bytes).ok().map(FileKind::Image)) {
            Some(FileKind::Image(
                format @ (ImageFormat::Png | ImageFormat::Pnm | ImageFormat::Jpeg | ImageFormat::Bmp | ImageFormat::WebP),
            )) => Ok(FileKind::Image(format)),
            Some(kind @ (FileKind::Tiff | FileKind::Pfm | FileKind::Npy | FileKind::Npz)) => Ok(kind),
            _ => Err(Error::format(path, "an unknown kind of file", PICTURES)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_kinds_are_refused_by_name() {
        for (start, name) in [
            (&b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"[..], "a HEIC image"),
            (b"\0\0\0\x1Cftypmif1\0\0\0\0mif1heic", "a HEIC image"),
            (b"\0\0\0\x1Cftypmif1\0\0\0\0avifmif1", "an AVIF image"),
            (b"\0\0\0\x1Cftypavif\0\0\0\0avifmif1", "an AVIF image"),
            (b"\0\0\0\x18ftypmp42", "a video"),
            (b"II*\0\x10\0\0\0CR\x02\0", "a CR2 raw photo"),
            (b"GIF89a", "a GIF image"),
            (b"\0\0\0\x0CjP  \r\n\x87\n", "a JPEG 2000 image"),
            (b"\xFF\x0A\xFA", "a JPEG XL image"),
            (b"%PDF-1.7", "a PDF document"),
            (b"#!/bin/sh\n", "an unknown kind of file"),
        ] {
            let message = FileKind::of(Path::new("c.png"), start).unwrap_err().to_string();
            assert!(message.starts_with(&format!("c.png: found {name}, expected a PNG, JPEG, TIFF")), "{message}");
        }
    }
}
