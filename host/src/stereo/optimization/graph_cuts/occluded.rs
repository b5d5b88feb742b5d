//! Occluded pixels.

use crate::images::DisparityMap;

/// A map in which pixels without a disparity have the smaller one of the nearest in their row, or in their column, before and after them; there
/// may be only one, or none.
pub fn filled(map: &DisparityMap, along_rows: bool) -> DisparityMap {
    let [width, height] = [map.width(), map.height()];
    let (lines, length) = if along_rows { (height, width) } else { (width, height) };
    let at = |line: usize, i: usize| if along_rows { line * width + i } else { i * width + line };
    let mut pixels = map.pixels().to_vec();
    for line in 0..lines {
        let mut i = 0;
        while i < length {
            let end = (i..length).find(|&i| pixels[at(line, i)].is_some()).unwrap_or(length);
            let before = i.checked_sub(1).and_then(|i| pixels[at(line, i)]);
            let after = (end < length).then(|| pixels[at(line, end)]).flatten();
            let nearest = before.into_iter().chain(after).min();
            (i..end).for_each(|i| pixels[at(line, i)] = nearest);
            i = end + 1;
        }
    }
    DisparityMap::new(width, height, pixels)
}
