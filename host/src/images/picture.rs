//! An 8-bit picture, grey or in colour.

use image::{GrayImage, Luma, Rgb, RgbImage};

/// An image with 8 bits per channel, as a file stores it.
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

    /// The red, green and blue of pixel `(u, v)`.
    ///
    /// # Panics
    /// If the pixel lies outside the picture.
    pub fn color(&self, u: u32, v: u32) -> [u8; 3] {
        match self {
            Picture::Gray(gray) => [gray.get_pixel(u, v).0[0]; 3],
            Picture::Rgb(rgb) => rgb.get_pixel(u, v).0,
        }
    }

    /// The picture in grey, as the matcher sees it. A colour becomes `(77 R + 150 G + 29 B + 128) >> 8`.
    pub fn to_gray(&self) -> GrayImage {
        match self {
            Picture::Gray(gray) => gray.clone(),
            Picture::Rgb(rgb) => GrayImage::from_fn(rgb.width(), rgb.height(), |u, v| Luma([gray_of(rgb.get_pixel(u, v).0)])),
        }
    }

    /// The picture in colour. A grey picture stays grey.
    pub fn to_rgb(&self) -> RgbImage {
        let (width, height) = self.dimensions();
        RgbImage::from_fn(width, height, |u, v| Rgb(self.color(u, v)))
    }
}

/// The grey value of a colour. The weights are those of ITU-R BT.601 in 256ths. They add up to 256, so grey
/// colours keep their value.
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
    fn gray_is_the_weighted_sum() {
        for (rgb, gray) in [([255, 255, 255], 255), ([0, 0, 0], 0), ([255, 0, 0], 77), ([0, 255, 0], 149), ([0, 0, 255], 29)] {
            assert_eq!(gray_of(rgb), gray, "{rgb:?}");
        }
        assert!((0..=255).all(|g| gray_of([g; 3]) == g));
        assert_eq!(Picture::Rgb(scene()).to_gray().get_pixel(20, 5).0[0], ((77 * 220 + 150 * 140 + 29 * 100 + 128) / 256) as u8);
    }
}
