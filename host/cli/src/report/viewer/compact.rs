//! Rasters as short text, without loss.

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::ZlibEncoder};
use image::GrayImage;
use multiscopic::images::DisparityMap;
use multiscopic_core::Disparity;

/// The number that stands for an invalid disparity.
const INVALID: i16 = i16::MIN;

/// The aim of shortening a text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Aim {
    /// That it is short.
    #[default]
    Size,
    /// That it is there soon.
    Time,
}

/// Grey values or confidences, row by row.
pub fn bytes(values: &[u8], width: usize, aim: Aim) -> String {
    let differences = differences(values, width, |value| i32::from(*value));
    deflated(&differences.iter().map(|difference| *difference as u8).collect::<Vec<_>>(), aim)
}

/// The grey values of an image.
pub fn gray(image: &GrayImage, aim: Aim) -> String {
    bytes(image.as_raw(), image.width() as usize, aim)
}

/// Disparities: all low bytes, then all high bytes.
pub fn disparities(map: &DisparityMap, aim: Aim) -> String {
    let bits = |pixel: &Option<Disparity>| i32::from(pixel.map_or(INVALID, Disparity::to_bits));
    let differences = differences(map.pixels(), map.width(), bits);
    let byte = |index: usize| differences.iter().map(move |difference| difference.to_le_bytes()[index]);
    deflated(&byte(0).chain(byte(1)).collect::<Vec<_>>(), aim)
}

/// The difference of each value from what its neighbours predict: the median of the left one, the one above, and the plane
/// through them and the one between (LOCO-I, Weinberger et al. 2000).
fn differences<T>(values: &[T], width: usize, number: impl Fn(&T) -> i32) -> Vec<i32> {
    let at = |i: usize| number(&values[i]);
    let predicted = |i: usize| {
        let (is_first, is_top) = (i.is_multiple_of(width), i < width);
        let left = match (is_first, is_top) {
            (true, true) => 0,
            (true, false) => at(i - width),
            (false, _) => at(i - 1),
        };
        let above = if is_top { left } else { at(i - width) };
        let corner = if is_first || is_top { above } else { at(i - width - 1) };
        let (low, high) = (left.min(above), left.max(above));
        if corner >= high {
            low
        } else if corner <= low {
            high
        } else {
            left + above - corner
        }
    };
    (0..values.len()).map(|i| at(i) - predicted(i)).collect()
}

fn deflated(bytes: &[u8], aim: Aim) -> String {
    let compression = match aim {
        Aim::Size => Compression::best(),
        Aim::Time => Compression::fast(),
    };
    let mut encoder = ZlibEncoder::new(Vec::new(), compression);
    encoder.write_all(bytes).expect("memory takes all bytes");
    STANDARD.encode(encoder.finish().expect("memory takes all bytes"))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;

    fn inflated(text: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        ZlibDecoder::new(&STANDARD.decode(text).unwrap()[..]).read_to_end(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn planes_leave_no_differences() {
        // Each value is one more than the left one and two more than the one above, but for the first row and column.
        let plane: Vec<u8> = (0..4).flat_map(|v| (0..5).map(move |u| 10 + u + 2 * v)).collect();
        let mut expected = [0; 20];
        expected[0] = 10;
        expected[1..5].fill(1);
        for first in [5, 10, 15] {
            expected[first] = 2;
        }
        // The plane through the neighbours lies between none of them: the median is the larger one.
        let clipped = |i: usize| if i < 5 || i.is_multiple_of(5) { expected[i] } else { 1 };
        assert_eq!(inflated(&bytes(&plane, 5, Aim::Size)), (0..20).map(clipped).collect::<Vec<_>>());
    }

    #[test]
    fn disparities_are_low_bytes_and_high_bytes() {
        let map = DisparityMap::new(2, 1, vec![Disparity::from_bits(0x0123), None]);
        let [low, high] = (i32::from(INVALID) - 0x0123).to_le_bytes()[..2].try_into().unwrap();
        for aim in [Aim::Size, Aim::Time] {
            assert_eq!(inflated(&disparities(&map, aim)), [0x23, low, 0x01, high]);
        }
    }
}
