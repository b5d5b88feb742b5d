//! The mean of pictures.

use image::{GrayImage, RgbImage};

use crate::images::Picture;

/// Sums pictures of one size, sample by sample.
#[derive(Default)]
pub(super) struct PictureMean {
    count: u32,
    sums: Vec<u32>,
    /// The last picture, whose samples are replaced by the mean.
    last: Option<Picture>,
}

impl PictureMean {
    /// Adds a picture, which becomes grey if one before was. The sums hold up to 65535 pictures.
    ///
    /// # Panics
    /// If it differs in size from one before.
    pub fn add(&mut self, picture: Picture) {
        let picture = picture.into_8_bits();
        let picture = match (&self.last, &picture) {
            (Some(Picture::Gray(_)), Picture::Rgb(_)) => Picture::Gray(picture.to_gray()),
            (Some(Picture::Rgb(_)), Picture::Gray(_)) => Picture::Rgb(picture.to_rgb()),
            _ => picture,
        };
        self.count += 1;
        let samples = samples(&picture);
        self.sums.resize(samples.len(), 0);
        self.sums.iter_mut().zip(samples).for_each(|(sum, &sample)| *sum += u32::from(sample));
        self.last = Some(picture);
    }

    /// The mean, rounded to the nearest, halves up. `None` without pictures.
    pub fn picture(self) -> Option<Picture> {
        let count = self.count;
        let mean = self.sums.iter().map(|sum| ((sum + count / 2) / count) as u8).collect();
        let last = self.last?;
        let (width, height) = last.dimensions();
        match last {
            Picture::Rgb(_) => RgbImage::from_raw(width, height, mean).map(Picture::Rgb),
            _ => GrayImage::from_raw(width, height, mean).map(Picture::Gray),
        }
    }
}

/// The samples of a picture of 8 bits.
fn samples(picture: &Picture) -> &[u8] {
    match picture {
        Picture::Gray(gray) => gray.as_raw(),
        Picture::Rgb(rgb) => rgb.as_raw(),
        Picture::Gray16(_) | Picture::Rgb16(_) => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(samples: &[u8]) -> Picture {
        Picture::Gray(GrayImage::from_raw(samples.len() as u32, 1, samples.to_vec()).unwrap())
    }

    #[test]
    fn means_are_rounded() {
        let mut mean = PictureMean::default();
        for picture in [[0, 255, 10, 1], [1, 255, 10, 1], [1, 254, 13, 1], [0, 255, 10, 0]] {
            mean.add(gray(&picture));
        }
        assert_eq!(mean.picture(), Some(gray(&[1, 255, 11, 1])));
        let mut white = PictureMean { count: 65534, sums: vec![255 * 65534], last: Some(gray(&[255])) };
        white.add(gray(&[255]));
        assert_eq!(white.picture(), Some(gray(&[255])));
        assert_eq!(PictureMean::default().picture(), None);
    }

    #[test]
    fn colours_have_means_of_their_own() {
        let color = |samples: [u8; 3]| Picture::Rgb(RgbImage::from_raw(1, 1, samples.to_vec()).unwrap());
        let mut mean = PictureMean::default();
        mean.add(color([0, 10, 200]));
        mean.add(color([2, 13, 100]));
        assert_eq!(mean.picture(), Some(color([1, 12, 150])));
    }
}
