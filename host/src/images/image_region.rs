//! Parts of images.

use std::str::FromStr;

use crate::error::{Error, Result};

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
    pub fn check(&self, [width, height]: [usize; 2]) -> Result<()> {
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

    fn from_str(text: &str) -> Result<ImageRegion> {
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
