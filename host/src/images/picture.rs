//! A picture of 8 or 16 bits, grey or in colour, the number of bits that carry values, and a region of it.

use std::str::FromStr;

use image::{GrayImage, ImageBuffer, Luma, Pixel, Rgb, RgbImage, imageops};
use serde::{Deserialize, Serialize};

use super::Raster;
use crate::error::Error;

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

    /// The picture shrunk by a whole factor: pixels are means of its squares. Rows and columns that are left over are cut off.
    pub fn shrunk(&self, factor: u32) -> Picture {
        let (width, height) = self.dimensions();
        let [width, height] = [width, height].map(|side| (side / factor).max(1));
        macro_rules! shrunk {
            ($image:ident) => {
                imageops::thumbnail(&*imageops::crop_imm($image, 0, 0, width * factor, height * factor), width, height)
            };
        }
        match self {
            Picture::Gray(image) => Picture::Gray(shrunk!(image)),
            Picture::Rgb(image) => Picture::Rgb(shrunk!(image)),
            Picture::Gray16(image) => Picture::Gray16(shrunk!(image)),
            Picture::Rgb16(image) => Picture::Rgb16(shrunk!(image)),
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
fn gray_of([r, g, b]: [u8; 3]) -> u8 {
    ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8
}

/// The number of bits in which a camera measured brightness before its samples were stored in 16 bits.
///
/// White is the largest number of that many bits. Left-justified samples, whose low bits are 0, have 16 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum BitDepth {
    /// 10 bits: white is 1023.
    Ten,
    /// 12 bits: white is 4095.
    Twelve,
    /// 14 bits: white is 16383.
    Fourteen,
    /// 16 bits: white is 65535.
    Sixteen,
}

impl BitDepth {
    /// All depths, from the least to the greatest.
    pub const ALL: [BitDepth; 4] = [BitDepth::Ten, BitDepth::Twelve, BitDepth::Fourteen, BitDepth::Sixteen];

    /// The number of bits: 10, 12, 14 or 16.
    pub const fn bits(self) -> u8 {
        match self {
            BitDepth::Ten => 10,
            BitDepth::Twelve => 12,
            BitDepth::Fourteen => 14,
            BitDepth::Sixteen => 16,
        }
    }

    /// The sample of white, which is the largest.
    pub const fn white(self) -> u16 {
        u16::MAX >> (16 - self.bits())
    }

    /// The least depth that has this sample.
    pub fn of_brightest(sample: u16) -> BitDepth {
        BitDepth::ALL.into_iter().find(|depth| sample <= depth.white()).unwrap_or(BitDepth::Sixteen)
    }

    /// A sample of this depth on the scale of 16 bits: 65535 times the sample through [`white`](BitDepth::white), rounded to
    /// nearest. Samples above white are white.
    pub fn to_16_bits(self, sample: u16) -> u16 {
        let white = u32::from(self.white());
        // White is odd, so no quotient is halfway between two numbers.
        ((u32::from(sample).min(white) * 65535 + white / 2) / white) as u16
    }
}

/// A sample of 16 bits in 8: 255 times the sample through 65535, rounded to nearest.
fn to_8_bits(sample: u16) -> u8 {
    ((u32::from(sample) + 128) / 257) as u8
}

impl From<BitDepth> for u8 {
    fn from(depth: BitDepth) -> u8 {
        depth.bits()
    }
}

impl TryFrom<u8> for BitDepth {
    type Error = String;

    fn try_from(bits: u8) -> Result<BitDepth, String> {
        let depth = BitDepth::ALL.into_iter().find(|depth| depth.bits() == bits);
        depth.ok_or_else(|| format!("{bits} bits, expected 10, 12, 14 or 16"))
    }
}

/// A rectangle of an image, in pixels. It is written as its left edge, its top edge, its width and its height, such as
/// `80,60,160,120`.
///
/// ```
/// use multiscopic::images::ImageRegion;
/// let region: ImageRegion = "80,60,160,120".parse().unwrap();
/// assert_eq!(region, ImageRegion::middle([320, 240]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageRegion {
    /// The leftmost column.
    pub left: usize,
    /// The topmost row.
    pub top: usize,
    /// The number of columns.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
}

impl ImageRegion {
    /// An image of a size, as a whole.
    pub fn whole([width, height]: [usize; 2]) -> ImageRegion {
        ImageRegion { left: 0, top: 0, width, height }
    }

    /// The middle half of the width and of the height of an image.
    pub fn middle([width, height]: [usize; 2]) -> ImageRegion {
        ImageRegion { left: width / 4, top: height / 4, width: width.div_ceil(2), height: height.div_ceil(2) }
    }

    /// Refuses a region that has no pixels, or leaves an image of a size.
    ///
    /// # Errors
    /// [`Error::Usage`], with both sizes.
    pub fn check(&self, [width, height]: [usize; 2]) -> Result<(), Error> {
        let &ImageRegion { left, top, width: columns, height: rows } = self;
        let fits = |start: usize, count: usize, side: usize| count > 0 && start.checked_add(count).is_some_and(|end| end <= side);
        match fits(left, columns, width) && fits(top, rows, height) {
            true => Ok(()),
            false => Err(Error::Usage(format!(
                "the region {left},{top},{columns},{rows} is empty or leaves the image of {width}x{height} pixels"
            ))),
        }
    }

    /// The number of pixels.
    pub(crate) fn area(&self) -> usize {
        self.width * self.height
    }

    /// The column and the row of each pixel, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let ImageRegion { left, top, width, height } = *self;
        (top..top + height).flat_map(move |v| (left..left + width).map(move |u| [u, v]))
    }
}

impl FromStr for ImageRegion {
    type Err = Error;

    fn from_str(text: &str) -> Result<ImageRegion, Error> {
        let numbers: Vec<Option<usize>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers[..] {
            [Some(left), Some(top), Some(width), Some(height)] => Ok(ImageRegion { left, top, width, height }),
            _ => Err(Error::Usage(
                "it must be four numbers of pixels: the left and top edges, width and height, as 80,60,160,120".into(),
            )),
        }
    }
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

    #[test]
    fn samples_of_every_depth_are_rounded_to_nearest() {
        for depth in BitDepth::ALL {
            let white = f64::from(depth.white());
            for sample in 0..=depth.white() {
                let share = f64::from(sample) / white;
                let deep = depth.to_16_bits(sample);
                assert_eq!(f64::from(deep), (65535.0 * share).round(), "{sample} of {depth:?}");
                // Both steps together round as one.
                assert_eq!(f64::from(to_8_bits(deep)), (255.0 * share).round(), "{sample} of {depth:?}");
            }
        }
        assert_eq!(BitDepth::Ten.to_16_bits(1024), 65535);
    }

    #[test]
    fn the_brightest_sample_tells_the_depth() {
        let depths = [0, 1023, 1024, 4095, 4096, 16383, 16384, 65535].map(|sample| BitDepth::of_brightest(sample).bits());
        assert_eq!(depths, [10, 10, 12, 12, 14, 14, 16, 16]);
    }

    #[test]
    fn other_numbers_of_bits_are_refused() {
        assert_eq!(BitDepth::try_from(14), Ok(BitDepth::Fourteen));
        assert_eq!(BitDepth::try_from(11), Err("11 bits, expected 10, 12, 14 or 16".into()));
    }

    #[test]
    fn regions_are_inside_their_image() {
        for size in [[1, 1], [2, 3], [5, 4], [320, 241]] {
            ImageRegion::whole(size).check(size).unwrap();
            ImageRegion::middle(size).check(size).unwrap();
        }
        for text in ["1,0,3,1", "0,0,0,1", "0,2,1,1", "18446744073709551615,0,2,1"] {
            let message = text.parse::<ImageRegion>().unwrap().check([3, 2]).unwrap_err().to_string();
            assert!(message.contains(&format!("the region {text} is empty or leaves the image of 3x2 pixels")), "{message}");
        }
        assert!(["", "1,2,3", "1,2,3,4,5", "1,2,3,-4", "a,b,c,d"].iter().all(|text| text.parse::<ImageRegion>().is_err()));
    }

    #[test]
    fn pixels_are_in_rows() {
        let region = ImageRegion { left: 3, top: 1, width: 2, height: 2 };
        assert_eq!(region.pixels().collect::<Vec<_>>(), [[3, 1], [4, 1], [3, 2], [4, 2]]);
        assert_eq!(region.area(), 4);
    }
}
