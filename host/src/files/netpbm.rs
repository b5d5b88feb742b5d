//! PGM, PPM and PAM files: what their headers say.

use std::{borrow::Cow, io::Cursor, path::Path};

use image::{
    ImageDecoder,
    codecs::pnm::{PnmDecoder, PnmSubtype, SampleEncoding},
};

use crate::error::{Error, Result};

/// The header of a PGM, PPM or PAM file.
pub(super) struct Netpbm {
    /// The sample of white.
    pub(super) white: u32,
    encoding: SampleEncoding,
    /// Bytes of a binary sample.
    sample_bytes: usize,
    /// The number of samples.
    samples: usize,
    /// Length of the header.
    start: usize,
}

impl Netpbm {
    /// Reads the header. Returns it with the file, whose header a single character ends. `None` if it is damaged.
    pub(super) fn read(bytes: &[u8]) -> Option<(Netpbm, Cow<'_, [u8]>)> {
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
        Some((Netpbm { white, encoding, sample_bytes, samples: total / sample_bytes, start }, bytes))
    }

    /// Checks that no sample in the bytes of [`read`](Netpbm::read) is above white. The decoder scales them nevertheless.
    pub(super) fn check(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let data = bytes.get(self.start..).unwrap_or_default();
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
