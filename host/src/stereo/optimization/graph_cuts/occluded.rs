//! Filling occluded pixels.

use crate::images::DisparityMap;

/// Fills each pixel without a disparity from the nearest disparities before and after it in its row, or in
/// its column if not `along_rows`: it takes the smaller one, that of the background. A line without any
/// disparity stays as it is.
pub fn fill(map: &DisparityMap, along_rows: bool) -> DisparityMap {
    let [width, height] = [map.width(), map.height()];
    let (lines, length) = if along_rows { (height, width) } else { (width, height) };
    let index = |line: usize, i: usize| if along_rows { line * width + i } else { i * width + line };
    let mut pixels = map.pixels().to_vec();
    for line in 0..lines {
        let mut i = 0;
        while i < length {
            let end = (i..length).find(|&i| pixels[index(line, i)].is_some()).unwrap_or(length);
            let before = i.checked_sub(1).and_then(|i| pixels[index(line, i)]);
            let after = (end < length).then(|| pixels[index(line, end)]).flatten();
            let nearest = before.into_iter().chain(after).min();
            (i..end).for_each(|i| pixels[index(line, i)] = nearest);
            i = end + 1;
        }
    }
    DisparityMap::new(width, height, pixels)
}
