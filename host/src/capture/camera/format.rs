//! The pixel formats that are understood.

use serde::Serialize;

/// How a camera sends pixels.
///
/// What becomes of them is 8-bit grey, in the range that the camera gives: luma is taken as it is. In the formats of grey and in JPEG
/// this is 0 to 255 as a rule, in YUYV and NV12 it is 16 to 235.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PixelFormat {
    /// 8-bit grey.
    Grey,
    /// A plane of 8-bit luma, and one of chroma, which is not used.
    Nv12,
    /// 8-bit luma and chroma in turns; chroma is not used.
    Yuyv,
    /// 10-bit grey in little-endian words; the low 2 bits are dropped.
    Y10,
    /// 12-bit grey in little-endian words; the low 4 bits are dropped.
    Y12,
    /// 16-bit grey in little-endian words; the low 8 bits are dropped.
    Y16,
    /// 8-bit red, green and blue, of which the grey is made that pictures from files have.
    Rgb3,
    /// A JPEG image for each frame, of which the grey is made that a JPEG file has.
    Mjpg,
}

impl PixelFormat {
    /// All of them, the best first: what is not compressed, and comes as luma, in few bytes.
    pub const ALL: [PixelFormat; 8] = {
        use PixelFormat::*;
        [Grey, Nv12, Yuyv, Y10, Y12, Y16, Rgb3, Mjpg]
    };

    /// The four characters by which V4L2 knows it.
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

    /// Its name: the four characters without spaces.
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

    /// The format of this name, in capitals or not.
    pub fn named(name: &str) -> Option<PixelFormat> {
        Self::ALL.into_iter().find(|format| format.name().eq_ignore_ascii_case(name))
    }

    /// The format with these four characters.
    pub(super) fn of_fourcc(fourcc: [u8; 4]) -> Option<PixelFormat> {
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// The names of all.
    pub(super) fn names() -> String {
        Self::ALL.map(PixelFormat::name).join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_the_four_characters() {
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
