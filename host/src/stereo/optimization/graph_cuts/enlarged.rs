//! Matching in enlarged images, whose whole disparities are fractions of a pixel of the original images.

use image::ImageBuffer;
use multiscopic_core::{BlockMatchingParams, Disparity, Frame, SearchConfig, SearchSpace};

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames, Picture},
};

/// The frames that `search` needs, enlarged by the factor `times`.
pub fn frames(frames: &Frames, search: &SearchSpace, times: u8) -> Frames {
    let picture = |frame| match frames.color(frame) {
        Some(color) => Picture::Rgb(image(color, times)),
        None => Picture::Gray(image(frames.get(frame).expect("the frames have every view of the search"), times)),
    };
    let center = Frames::of_picture(picture(Frame::Center));
    search.views().iter().fold(center, |frames, view| frames.with_picture(view, picture(Frame::View(view))))
}

/// An image enlarged by the factor `times`: linear interpolation between the centres of its pixels, rounded
/// to the nearest, halves up. Beyond its borders the image is extended by replication.
fn image<P: image::Pixel<Subpixel = u8>>(image: &ImageBuffer<P, Vec<u8>>, times: u8) -> ImageBuffer<P, Vec<u8>> {
    let times = u32::from(times);
    // The pixels before and after a coordinate, and its distance to the first in steps of 1 / (2 * times)
    // pixels.
    let around = |coordinate: u32, size: u32| {
        let (parts, of) = (2 * coordinate as i32 + 1 - times as i32, 2 * times as i32);
        let first = parts.div_euclid(of);
        let inside = |pixel: i32| pixel.clamp(0, size as i32 - 1) as u32;
        ([inside(first), inside(first + 1)], parts.rem_euclid(of) as u32)
    };
    ImageBuffer::from_fn(times * image.width(), times * image.height(), |x, y| {
        let ([left, right], across) = around(x, image.width());
        let ([top, bottom], down) = around(y, image.height());
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(u, v)| image.get_pixel(u, v).channels());
        let of = 2 * times;
        let weights = [(of - across) * (of - down), across * (of - down), (of - across) * down, across * down];
        let mut pixel = *image.get_pixel(left, top);
        for (c, sample) in pixel.channels_mut().iter_mut().enumerate() {
            let sum: u32 = corners.iter().zip(weights).map(|(corner, weight)| u32::from(corner[c]) * weight).sum();
            *sample = ((sum + of * of / 2) / (of * of)) as u8;
        }
        pixel
    })
}

/// The parameters for frames enlarged by the factor `times`. The block grows by the same factor, up to the
/// largest block there is.
///
/// # Errors
/// [`Error::Usage`] if the enlarged frames or their disparities are too large.
pub fn params(search: &BlockMatchingParams, times: u8) -> Result<BlockMatchingParams> {
    let factor = i32::from(times);
    let [width, height] = [search.width(), search.height()].map(|side| side * usize::from(times));
    let too_large = |found: String| Error::Usage(format!("images enlarged {times} times have {found}: enlarge less"));
    let side =
        |length: usize| u16::try_from(length).map_err(|_| too_large(format!("a side of {length} pixels, and 65535 is the most")));
    let [least, most] = [search.min_disparity(), search.max_disparity()].map(|d| i32::from(d) * factor);
    if least < i32::from(Disparity::MIN_SEARCH) || most > i32::from(Disparity::MAX_SEARCH) {
        return Err(too_large(format!("disparities {least}..={most}, and 511 is the most, either way")));
    }
    let block = ((search.block_size() * usize::from(times)) | 1).min(BlockMatchingParams::MAX_BLOCK_SIZE.into());
    let (min_disparity, num_disparities) = (least as i16, (most - least + 1) as u16);
    let (width, height) = (side(width)?, side(height)?);
    let enlarged = SearchConfig { width, height, min_disparity, num_disparities, ..search.search().config() };
    Ok(enlarged.block_matching(block as u8)?)
}

/// The map of frames enlarged by the factor `times`, reduced to their original size. Each pixel has the
/// median of its block of `times` x `times` disparities, of an even number the upper one, rounded to the
/// nearest step, halves away from zero. It is invalid if more than half of the block is.
pub fn reduced(map: &DisparityMap, times: u8) -> DisparityMap {
    let times = usize::from(times);
    let (width, height) = (map.width() / times, map.height() / times);
    let pixel = |i: usize| {
        let (left, top) = (i % width * times, i / width * times);
        let block = (top..top + times).flat_map(|v| &map.row(v)[left..left + times]);
        let mut block: Vec<Disparity> = block.copied().flatten().collect();
        if 2 * block.len() < times * times {
            return None;
        }
        let middle = block.len() / 2;
        let bits = f64::from(block.select_nth_unstable(middle).1.to_bits());
        Disparity::from_bits((bits / times as f64).round() as i16)
    };
    DisparityMap::new(width, height, (0..width * height).map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};
    use multiscopic_core::{Fusion, Views};

    use super::*;

    #[test]
    fn interpolates_between_pixel_centres() {
        let row = GrayImage::from_raw(3, 1, vec![10, 30, 90]).unwrap();
        assert_eq!(image(&row, 1), row);
        // Enlarged twice, samples lie a quarter of a pixel before and after the centres.
        assert_eq!(image(&row, 2).rows().next().unwrap().map(|Luma([x])| *x).collect::<Vec<_>>(), [10, 15, 25, 45, 75, 90]);
        assert_eq!(image(&row, 3).as_raw()[9..18], [10, 10, 17, 23, 30, 50, 70, 90, 90]);
        let column = GrayImage::from_raw(1, 2, vec![0, 100]).unwrap();
        assert_eq!(image(&column, 4).as_raw().chunks(4).map(|row| row[3]).collect::<Vec<_>>(), [0, 0, 13, 38, 63, 88, 100, 100]);
    }

    #[test]
    fn reduces_blocks_to_their_medians() {
        let pixel = |bits: Option<i16>| bits.and_then(Disparity::from_bits);
        let map =
            DisparityMap::new(4, 2, [Some(64), Some(67), None, Some(-64), Some(200), None, None, Some(-67)].map(pixel).into());
        assert_eq!(reduced(&map, 2).pixels(), [Some(34), Some(-32)].map(pixel));
        let sparse = DisparityMap::new(2, 2, [Some(64), None, None, None].map(pixel).into());
        assert_eq!(reduced(&sparse, 2).pixels(), [None]);
    }

    #[test]
    fn refuses_frames_that_are_too_large() {
        let search = |width: u16, least: i16, count: u16| {
            SearchConfig {
                width,
                height: 10,
                views: Views::STEREO,
                fusion: Fusion::Min,
                min_disparity: least,
                num_disparities: count,
            }
            .block_matching(11)
            .unwrap()
        };
        let enlarged = params(&search(100, -3, 8), 4).unwrap();
        assert_eq!(
            enlarged,
            SearchConfig {
                width: 400,
                height: 40,
                views: Views::STEREO,
                fusion: Fusion::Min,
                min_disparity: -12,
                num_disparities: 29
            }
            .block_matching(21)
            .unwrap()
        );
        let message = |search: BlockMatchingParams, times: u8| params(&search, times).unwrap_err().to_string();
        assert!(message(search(20000, 1, 9), 4).contains("a side of 80000 pixels"));
        assert!(message(search(100, 1, 200), 3).contains("disparities 3..=600"));
        assert!(params(&search(100, 1, 170), 3).is_ok());
    }
}
