//! Several pictures side by side in one image.

use image::{
    RgbImage, Rgba, RgbaImage,
    imageops::{self, FilterType},
};

/// The gap between two pictures, in pixels.
pub const GAP: u32 = 8;

/// Puts `pictures` in a row from left to right, scaling down those wider than `max_width` pixels. The rest is
/// transparent.
///
/// ```
/// use image::RgbImage;
/// use multiscopic::images::montage::{self, GAP};
/// let row = montage::row([&RgbImage::new(40, 30), &RgbImage::new(10, 10)], 20);
/// assert_eq!(row.dimensions(), (20 + GAP + 10, 15));
/// ```
///
/// # Panics
/// If there is no picture, or one is empty.
pub fn row<'a>(pictures: impl IntoIterator<Item = &'a RgbImage>, max_width: u32) -> RgbaImage {
    let panels: Vec<RgbImage> = pictures.into_iter().map(|picture| scaled_down(picture, max_width)).collect();
    let width = panels.iter().map(|panel| panel.width() + GAP).sum::<u32>() - GAP;
    let height = panels.iter().map(RgbImage::height).max().expect("a montage needs a picture");
    let mut row = RgbaImage::new(width, height);
    let mut left = 0;
    for panel in &panels {
        for (u, v, &pixel) in panel.enumerate_pixels() {
            let [red, green, blue] = pixel.0;
            row.put_pixel(left + u, v, Rgba([red, green, blue, 255]));
        }
        left += panel.width() + GAP;
    }
    row
}

/// Returns the picture, scaled down if it is wider than `max_width` pixels.
///
/// # Panics
/// If the picture is empty.
pub fn scaled_down(picture: &RgbImage, max_width: u32) -> RgbImage {
    let (width, height) = picture.dimensions();
    assert!(width > 0 && height > 0, "the picture is {width}x{height} pixels");
    if width <= max_width {
        return picture.clone();
    }
    let scaled = (u64::from(height) * u64::from(max_width) + u64::from(width) / 2) / u64::from(width);
    imageops::resize(picture, max_width, scaled.max(1) as u32, FilterType::Triangle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn pictures_keep_their_order_and_pixels() {
        let [red, blue] = [[200, 0, 0], [0, 0, 200]].map(|color| RgbImage::from_pixel(3, 2, Rgb(color)));
        let row = row([&red, &blue], 3);
        assert_eq!(row.dimensions(), (6 + GAP, 2));
        assert_eq!(
            [row[(2, 1)], row[(3, 1)], row[(3 + GAP, 0)]].map(|pixel| pixel.0),
            [[200, 0, 0, 255], [0; 4], [0, 0, 200, 255]]
        );
    }

    #[test]
    fn a_flat_picture_stays_flat_when_scaled() {
        let row = row([&RgbImage::from_pixel(64, 48, Rgb([9, 99, 199]))], 16);
        assert_eq!(row, RgbaImage::from_pixel(16, 12, Rgba([9, 99, 199, 255])));
    }
}
