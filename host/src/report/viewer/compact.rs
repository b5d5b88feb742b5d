//! Rasters as short text, without loss.

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::ZlibEncoder};
use image::GrayImage;
use multiscopic_core::Disparity;

use crate::images::DisparityMap;

/// The number that stands for an invalid disparity.
const INVALID: i16 = i16::MIN;

/// Grey values or confidences, row by row.
pub fn bytes(values: &[u8], width: usize) -> String {
    let differences = differences(values, width, |value| i32::from(*value));
    deflated(&differences.iter().map(|difference| *difference as u8).collect::<Vec<_>>())
}

/// The grey values of an image.
pub fn gray(image: &GrayImage) -> String {
    bytes(image.as_raw(), image.width() as usize)
}

/// Disparities: all low bytes, then all high bytes.
pub fn disparities(map: &DisparityMap) -> String {
    let bits = |pixel: &Option<Disparity>| i32::from(pixel.map_or(INVALID, Disparity::to_bits));
    let differences = differences(map.pixels(), map.width(), bits);
    let byte = |index: usize| differences.iter().map(move |difference| difference.to_le_bytes()[index]);
    deflated(&byte(0).chain(byte(1)).collect::<Vec<_>>())
}

/// The difference of each value from what its neighbours predict: the median of the left one, the one above, and the plane through
/// them and the one between (LOCO-I, Weinberger et al. 2000).
fn differences<T>(values: &[T], width: usize, number: impl Fn(&T) -> i32) -> Vec<i32> {
    let at = |i: usize| number(&values[i]);
    let predicted = |i: usize| {
        let (is_first, is_top) = (i % width == 0, i < width);
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

fn deflated(bytes: &[u8]) -> String {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).expect("memory takes all bytes");
    STANDARD.encode(encoder.finish().expect("memory takes all bytes"))
}
