//! The supported pixel formats.

use serde::Serialize;

/// How a camera encodes pixels.
///
/// They are converted to 8-bit grey. Luma is not rescaled: it usually ranges from 0 to 255 in the grey
/// formats and in JPEG, and from 16 to 235 in YUYV and NV12.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PixelFormat {
    /// 8-bit grey.
    Grey,
    /// A plane of 8-bit luma, then one of chroma, which is ignored.
    Nv12,
    /// 8-bit luma and chroma, alternating; chroma is ignored.
    Yuyv,
    /// 10-bit grey in little-endian words; the low 2 bits are dropped.
    Y10,
    /// 12-bit grey in little-endian words; the low 4 bits are dropped.
    Y12,
    /// 16-bit grey in little-endian words; the low 8 bits are dropped.
    Y16,
    /// 8-bit red, green and blue, converted to grey like picture files.
    Rgb3,
    /// One JPEG image per frame, converted to grey like JPEG files.
    Mjpg,
}

impl PixelFormat {
    /// All formats, in order of preference: uncompressed before compressed, luma before RGB, few bytes before
    /// many.
    pub const ALL: [PixelFormat; 8] = {
        use PixelFormat::*;
        [Grey, Nv12, Yuyv, Y10, Y12, Y16, Rgb3, Mjpg]
    };

    /// Its four-character code in V4L2.
    pub fn fourcc(self) -> [u8; 4] {
        match self {
            PixelFormat::Grey => *b"GREY",
            PixelFormat::Nv12 => *b"NV12",
            PixelFormat::Yuyv => *b"YUYV",
            PixelFormat::Y10 => *b"Y10 ",
            PixelFormat::Y12 => *b"Y12 ",
            PixelFormat::Y16 => *b"Y16 ",
            PixelFormat::Rgb3 => *b"RGB3",
            PixelFormat::Mjpg => *b"MJPG",
        }
    }

    /// Its name: the four-character code without padding.
    pub fn name(self) -> &'static str {
        match self {
            PixelFormat::Grey => "GREY",
            PixelFormat::Nv12 => "NV12",
            PixelFormat::Yuyv => "YUYV",
            PixelFormat::Y10 => "Y10",
            PixelFormat::Y12 => "Y12",
            PixelFormat::Y16 => "Y16",
            PixelFormat::Rgb3 => "RGB3",
            PixelFormat::Mjpg => "MJPG",
        }
    }

    /// The format with this name, in any case. `None` if there is none.
    pub fn named(name: &str) -> Option<PixelFormat> {
        Self::ALL.into_iter().find(|format| format.name().eq_ignore_ascii_case(name))
    }

    /// The format with this four-character code.
    pub fn of_fourcc(fourcc: [u8; 4]) -> Option<PixelFormat> {
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// All names, for messages.
    pub fn names() -> String {
        Self::ALL.map(PixelFormat::name).join(", ")
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
        }
        assert_eq!((PixelFormat::named("BA81"), PixelFormat::of_fourcc(*b"Y10B")), (None, None));
    }
}
