//! A picture of 8 or 16 bits, grey or in colour.

use image::{GrayImage, ImageBuffer, Luma, Pixel, Rgb, RgbImage};

use super::{Raster, bit_depth::to_8_bits};

/// An image with 8 or 16 bits per channel, as a file stores it. Matching takes 8 bits: those of a 16-bit sample are 255 times
/// the sample through 65535, rounded to nearest.
///
/// ```
/// use image::{Rgb, RgbImage};
/// use multiscopic::Picture;
/// let red = Picture::Rgb(RgbImage::from_pixel(4, 3, Rgb([255, 0, 0])));
/// assert_eq!(red.dimensions(), (4, 3));
/// assert_eq!(red.to_gray().get_pixel(0, 0).0, [77]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Picture {
    /// One channel.
    Gray(GrayImage),
    /// Red, green and blue.
    Rgb(RgbImage),
    /// One channel of 16 bits, of which 65535 is white.
    Gray16(ImageBuffer<Luma<u16>, Vec<u16>>),
    /// Red, green and blue of 16 bits each.
    Rgb16(ImageBuffer<Rgb<u16>, Vec<u16>>),
}

impl From<&Raster<u8>> for Picture {
    /// A byte for every pixel, in grey.
    fn from(raster: &Raster<u8>) -> Picture {
        let (width, height) = (raster.width() as u32, raster.height() as u32);
        Picture::Gray(GrayImage::from_raw(width, height, raster.pixels().to_vec()).expect("a byte for every pixel"))
    }
}

impl Picture {
    /// Width and height in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        match self {
            Picture::Gray(gray) => gray.dimensions(),
            Picture::Rgb(rgb) => rgb.dimensions(),
            Picture::Gray16(gray) => gray.dimensions(),
            Picture::Rgb16(rgb) => rgb.dimensions(),
        }
    }

    /// Returns true if its channels have 16 bits.
    pub fn has_16_bits(&self) -> bool {
        matches!(self, Picture::Gray16(_) | Picture::Rgb16(_))
    }

    /// The picture in 8 bits, grey or in colour as it is.
    pub fn into_8_bits(self) -> Picture {
        match self {
            Picture::Gray16(gray) => Picture::Gray(in_8_bits(&gray)),
            Picture::Rgb16(rgb) => Picture::Rgb(in_8_bits(&rgb)),
            picture => picture,
        }
    }

    /// The red, green and blue of pixel `(u, v)`, in 8 bits.
    ///
    /// # Panics
    /// If the pixel lies outside the picture.
    pub fn color(&self, u: u32, v: u32) -> [u8; 3] {
        match self {
            Picture::Gray(gray) => [gray.get_pixel(u, v).0[0]; 3],
            Picture::Rgb(rgb) => rgb.get_pixel(u, v).0,
            Picture::Gray16(gray) => [to_8_bits(gray.get_pixel(u, v).0[0]); 3],
            Picture::Rgb16(rgb) => rgb.get_pixel(u, v).0.map(to_8_bits),
        }
    }

    /// The picture in 8-bit grey, as the matcher sees it. A colour becomes `(77 R + 150 G + 29 B + 128) >> 8`, of its 8-bit
    /// channels.
    pub fn to_gray(&self) -> GrayImage {
        match self {
            Picture::Gray(gray) => gray.clone(),
            Picture::Gray16(gray) => in_8_bits(gray),
            Picture::Rgb(_) | Picture::Rgb16(_) => {
                let (width, height) = self.dimensions();
                GrayImage::from_fn(width, height, |u, v| Luma([gray_of(self.color(u, v))]))
            }
        }
    }

    /// The picture in 8-bit colour. A grey picture stays grey.
    pub fn to_rgb(&self) -> RgbImage {
        let (width, height) = self.dimensions();
        RgbImage::from_fn(width, height, |u, v| Rgb(self.color(u, v)))
    }
}

/// An image in 8 bits.
fn in_8_bits<P, Q>(image: &ImageBuffer<P, Vec<u16>>) -> ImageBuffer<Q, Vec<u8>>
where
    P: Pixel<Subpixel = u16>,
    Q: Pixel<Subpixel = u8>,
{
    let samples = image.as_raw().iter().map(|&sample| to_8_bits(sample)).collect();
    ImageBuffer::from_raw(image.width(), image.height(), samples).expect("as many samples as before")
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
    fn sixteen_bits_are_rounded_to_eight() {
        let deep = ImageBuffer::from_raw(2, 1, vec![65535, 0, 32768, 128, 129, 65407]).map(Picture::Rgb16).unwrap();
        let expected = RgbImage::from_raw(2, 1, vec![255, 0, 128, 0, 1, 255]).unwrap();
        assert!(deep.has_16_bits() && deep.dimensions() == (2, 1));
        assert_eq!([deep.color(0, 0), deep.color(1, 0)], [[255, 0, 128], [0, 1, 255]]);
        assert_eq!((deep.to_rgb(), deep.to_gray()), (expected.clone(), Picture::Rgb(expected.clone()).to_gray()));
        assert_eq!(deep.into_8_bits(), Picture::Rgb(expected));
        let deep = ImageBuffer::from_raw(2, 1, vec![385, 386]).map(Picture::Gray16).unwrap();
        assert_eq!((deep.color(0, 0), deep.to_gray().as_raw()), ([1; 3], &vec![1, 2]));
        assert!(!deep.into_8_bits().has_16_bits());
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
