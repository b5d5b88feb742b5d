//! The mean of several frames.

use image::GrayImage;

/// Sums frames of one size.
#[derive(Default)]
pub(super) struct FrameMean {
    count: u32,
    sums: Vec<u32>,
}

impl FrameMean {
    /// Adds a frame. The sums hold up to 65535 frames.
    pub(super) fn add(&mut self, image: &GrayImage) {
        self.count += 1;
        self.sums.resize(image.len(), 0);
        self.sums.iter_mut().zip(image.as_raw()).for_each(|(sum, &pixel)| *sum += u32::from(pixel));
    }

    /// The mean, rounded to the nearest, halves up.
    pub(super) fn image(&self, [width, height]: [u32; 2]) -> GrayImage {
        let mean = |sum: &u32| ((sum + self.count / 2) / self.count) as u8;
        GrayImage::from_raw(width, height, self.sums.iter().map(mean).collect()).expect("the frames have this size")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_rounded() {
        let mut mean = FrameMean::default();
        let images = [[0, 255, 10, 1], [1, 255, 10, 1], [1, 254, 13, 1], [0, 255, 10, 0]];
        for (i, image) in images.into_iter().enumerate() {
            mean.add(&GrayImage::from_raw(2, 2, image.to_vec()).unwrap());
            if i == 0 {
                assert_eq!(mean.image([2, 2]).as_raw(), &image);
            }
        }
        assert_eq!(mean.image([2, 2]).as_raw(), &[1, 255, 11, 1]);
        let mut white = FrameMean { count: 65534, sums: vec![255 * 65534] };
        white.add(&GrayImage::from_raw(1, 1, vec![255]).unwrap());
        assert_eq!(white.image([1, 1]).as_raw(), &[255]);
    }
}
