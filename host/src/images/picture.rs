//! Pictures of a scene, in 8 bits.

use image::{GrayImage, Luma, Rgb, RgbImage};

/// A frame as its file has it: grey, or in colour.
#[derive(Clone, Debug, PartialEq)]
pub enum Picture {
    /// One channel.
    Gray(GrayImage),
    /// Red, green and blue.
    Rgb(RgbImage),
}

impl Picture {
    /// Width and height in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        match self {
            Picture::Gray(gray) => gray.dimensions(),
            Picture::Rgb(rgb) => rgb.dimensions(),
        }
    }

    /// The red, green and blue of a pixel.
    ///
    /// # Panics
    /// If it lies outside.
    pub fn color(&self, u: u32, v: u32) -> [u8; 3] {
        match self {
            Picture::Gray(gray) => [gray.get_pixel(u, v).0[0]; 3],
            Picture::Rgb(rgb) => rgb.get_pixel(u, v).0,
        }
    }

    /// What the matcher sees: grey as it is, and `(77 R + 150 G + 29 B + 128) >> 8` of a colour.
    pub fn to_gray(&self) -> GrayImage {
        match self {
            Picture::Gray(gray) => gray.clone(),
            Picture::Rgb(rgb) => GrayImage::from_fn(rgb.width(), rgb.height(), |u, v| Luma([gray_of(rgb.get_pixel(u, v).0)])),
        }
    }

    /// The same in colour.
    pub fn to_rgb(&self) -> RgbImage {
        let (width, height) = self.dimensions();
        RgbImage::from_fn(width, height, |u, v| Rgb(self.color(u, v)))
    }
}

/// The grey of a colour. The weights are those of ITU-R BT.601 in 256ths; they sum to 256, so that a grey colour stays what it is.
pub(crate) fn gray_of([r, g, b]: [u8; 3]) -> u8 {
    ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> RgbImage {
        RgbImage::from_fn(23, 9, |u, v| Rgb([(u * 11) as u8, (v * 28) as u8, (u * v) as u8]))
    }

    #[test]
    fn gray_is_the_normative_sum() {
        for (rgb, gray) in [([255, 255, 255], 255), ([0, 0, 0], 0), ([255, 0, 0], 77), ([0, 255, 0], 149), ([0, 0, 255], 29)] {
            assert_eq!(gray_of(rgb), gray, "{rgb:?}");
        }
        assert!((0..=255).all(|g| gray_of([g; 3]) == g));
        assert_eq!(Picture::Rgb(scene()).to_gray().get_pixel(20, 5).0[0], ((77 * 220 + 150 * 140 + 29 * 100 + 128) / 256) as u8);
    }
}
