//! The encodings of cameras' pixels.

use serde::Serialize;

/// The encoding of a camera's pixels.
///
/// They are converted to 8 bits, grey or in colour. Luma is not rescaled: it usually ranges from 0 to 255 in the grey formats and in
/// JPEG, and from 16 to 235 beside chroma. Chroma becomes colours as in JPEG (ITU-T T.871), so that the grey of a colour is its
/// luma, but for rounding and what red, green and blue cannot hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PixelFormat {
    /// 8-bit grey.
    Grey,
    /// A plane of 8-bit luma, then one of blue and red chroma.
    Nv12,
    /// A plane of 8-bit luma, then one of red and blue chroma.
    Nv21,
    /// A plane of 8-bit luma, then those of blue and red chroma; also called I420.
    Yu12,
    /// A plane of 8-bit luma, then those of red and blue chroma.
    Yv12,
    /// 8-bit luma before each byte of chroma, blue first.
    Yuyv,
    /// 8-bit luma before each byte of chroma, red first.
    Yvyu,
    /// 8-bit luma after each byte of chroma, blue first.
    Uyvy,
    /// 8-bit luma after each byte of chroma, red first.
    Vyuy,
    /// 10-bit grey in little-endian words; the low 2 bits are dropped.
    Y10,
    /// 12-bit grey in little-endian words; the low 4 bits are dropped.
    Y12,
    /// 16-bit grey in little-endian words; the low 8 bits are dropped.
    Y16,
    /// 8-bit red, green and blue, as in picture files.
    Rgb3,
    /// 8-bit blue, green and red, as in picture files.
    Bgr3,
    /// One JPEG image per frame, as in JPEG files; it may lack Huffman tables.
    Mjpg,
    /// One JPEG image per frame, as in JPEG files.
    Jpeg,
}

/// The layout of a format's frames.
#[cfg_attr(not(all(target_os = "linux", feature = "v4l2")), expect(dead_code, reason = "no camera delivers frames"))]
pub(super) struct Encoding {
    /// The four-character code in V4L2.
    fourcc: &'static [u8; 4],
    /// Bytes of a pixel in the first plane.
    pub pixel_bytes: usize,
    /// The grey of a pixel.
    pub gray: GraySample,
    /// The place of its chroma.
    pub chroma: Chroma,
}

/// The place of a pixel's chroma, which it shares with its neighbour.
#[derive(Clone, Copy)]
#[cfg_attr(not(all(target_os = "linux", feature = "v4l2")), expect(dead_code, reason = "no camera delivers frames"))]
pub(super) enum Chroma {
    /// There is none.
    None,
    /// The bytes of blue and red, among the four of two pixels.
    Packed([usize; 2]),
    /// Planes after that of luma, this many, with half as many rows, and together the bytes of a row of luma in each. The first
    /// samples are blue, or else red.
    Planes(u64, First),
}

/// The chroma that comes first.
#[derive(Clone, Copy)]
#[cfg_attr(not(all(target_os = "linux", feature = "v4l2")), expect(dead_code, reason = "no camera delivers frames"))]
pub(super) enum First {
    Blue,
    Red,
}

/// The place of a pixel's grey among its bytes.
#[derive(Clone, Copy)]
#[cfg_attr(not(all(target_os = "linux", feature = "v4l2")), expect(dead_code, reason = "no camera delivers frames"))]
pub(super) enum GraySample {
    /// In the byte of this index.
    Byte(usize),
    /// In a little-endian word, without this many low bits.
    Word(u32),
    /// In the bytes of these indices, which are red, green and blue.
    Color([usize; 3]),
    /// The frame is a JPEG image.
    Jpeg,
}

impl PixelFormat {
    /// All formats, in order of preference: uncompressed before compressed, colour before grey, luma before RGB, few bytes before
    /// many.
    pub const ALL: [PixelFormat; 16] = {
        use PixelFormat::*;
        [Nv12, Nv21, Yu12, Yv12, Yuyv, Yvyu, Uyvy, Vyuy, Rgb3, Bgr3, Grey, Y10, Y12, Y16, Mjpg, Jpeg]
    };

    pub(super) const fn encoding(self) -> Encoding {
        use Chroma::{None, Packed, Planes};
        use GraySample::{Byte, Color, Word};
        let (fourcc, pixel_bytes, gray, chroma) = match self {
            PixelFormat::Grey => (b"GREY", 1, Byte(0), None),
            PixelFormat::Nv12 => (b"NV12", 1, Byte(0), Planes(1, First::Blue)),
            PixelFormat::Nv21 => (b"NV21", 1, Byte(0), Planes(1, First::Red)),
            PixelFormat::Yu12 => (b"YU12", 1, Byte(0), Planes(2, First::Blue)),
            PixelFormat::Yv12 => (b"YV12", 1, Byte(0), Planes(2, First::Red)),
            PixelFormat::Yuyv => (b"YUYV", 2, Byte(0), Packed([1, 3])),
            PixelFormat::Yvyu => (b"YVYU", 2, Byte(0), Packed([3, 1])),
            PixelFormat::Uyvy => (b"UYVY", 2, Byte(1), Packed([0, 2])),
            PixelFormat::Vyuy => (b"VYUY", 2, Byte(1), Packed([2, 0])),
            PixelFormat::Y10 => (b"Y10 ", 2, Word(2), None),
            PixelFormat::Y12 => (b"Y12 ", 2, Word(4), None),
            PixelFormat::Y16 => (b"Y16 ", 2, Word(8), None),
            PixelFormat::Rgb3 => (b"RGB3", 3, Color([0, 1, 2]), None),
            PixelFormat::Bgr3 => (b"BGR3", 3, Color([2, 1, 0]), None),
            PixelFormat::Mjpg => (b"MJPG", 1, GraySample::Jpeg, None),
            PixelFormat::Jpeg => (b"JPEG", 1, GraySample::Jpeg, None),
        };
        Encoding { fourcc, pixel_bytes, gray, chroma }
    }

    /// Its four-character code in V4L2.
    pub fn fourcc(self) -> [u8; 4] {
        *self.encoding().fourcc
    }

    /// Its four-character code in V4L2 where each plane has memory of its own. `None` if it has one plane.
    pub fn fourcc_of_planes(self) -> Option<[u8; 4]> {
        match self {
            PixelFormat::Nv12 => Some(*b"NM12"),
            PixelFormat::Nv21 => Some(*b"NM21"),
            PixelFormat::Yu12 => Some(*b"YM12"),
            PixelFormat::Yv12 => Some(*b"YM21"),
            _ => None,
        }
    }

    /// Its name: the four-character code without padding.
    pub fn name(self) -> &'static str {
        str::from_utf8(self.encoding().fourcc.trim_ascii_end()).unwrap_or_default()
    }

    /// The format with this name, or that of its planes with memory of their own, in any case. `None` if there is none.
    pub fn named(name: &str) -> Option<PixelFormat> {
        let has = |code: &[u8]| code.eq_ignore_ascii_case(name.as_bytes());
        let is_named = |format: &Self| has(format.name().as_bytes()) || format.fourcc_of_planes().is_some_and(|code| has(&code));
        Self::ALL.into_iter().find(is_named)
    }

    /// The format with this four-character code, in one piece or with memory for each plane.
    pub fn of_fourcc(fourcc: [u8; 4]) -> Option<PixelFormat> {
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc || format.fourcc_of_planes() == Some(fourcc))
    }

    /// All names, for messages.
    pub fn names() -> String {
        Self::ALL.map(PixelFormat::name).join(", ")
    }

    /// Returns true if frames are JPEG images.
    pub fn is_compressed(self) -> bool {
        matches!(self.encoding().gray, GraySample::Jpeg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_four_character_codes_without_padding() {
        for format in PixelFormat::ALL {
            let fourcc = format.fourcc();
            assert_eq!(str::from_utf8(&fourcc).unwrap().trim_end(), format.name());
            assert_eq!(PixelFormat::named(&format.name().to_lowercase()), Some(format));
            assert_eq!(PixelFormat::of_fourcc(fourcc), Some(format));
            assert_eq!(serde_json::to_value(format).unwrap(), format.name());
            if let Some(fourcc) = format.fourcc_of_planes() {
                assert_eq!(PixelFormat::named(str::from_utf8(&fourcc).unwrap()), Some(format));
                assert_eq!(PixelFormat::of_fourcc(fourcc), Some(format));
            }
        }
        assert_eq!((PixelFormat::named("BA81"), PixelFormat::of_fourcc(*b"Y10B")), (None, None));
    }
}
