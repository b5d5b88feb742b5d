//! Holes filled from the background beside them.

use crate::images::{DisparityMap, Raster};

/// Fills invalid pixels with the smaller, that is the background's, of the nearest disparities to the left and to the right:
/// what one view sees and another does not is hidden by the nearer surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BackgroundFill;

impl BackgroundFill {
    /// The name on command lines.
    pub const NAME: &str = "background";

    /// The filled map and its confidence. A filled pixel has half the confidence of the one whose disparity it took.
    ///
    /// A row without any disparity takes, pixel by pixel, the smaller of the nearest disparities above and below, when all other
    /// rows are filled. A map without any stays as it is; so does the confidence of invalid pixels there.
    ///
    /// # Panics
    /// If the sizes of the two differ.
    pub fn apply(self, map: &DisparityMap, confidence: &Raster<u8>) -> (DisparityMap, Raster<u8>) {
        assert_eq!([confidence.width(), confidence.height()], [map.width(), map.height()], "the size of the confidence");
        let rows = sources(map, true);
        let filled = take(map, &rows);
        let columns = sources(&filled, false);
        let mut result = confidence.clone();
        for (i, value) in result.pixels_mut().iter_mut().enumerate() {
            // Only pixels of the map itself are sources of rows, and of rows that are not empty.
            if map.pixels()[i].is_none()
                && let Some(source) = columns[i].and_then(|i| rows[i])
            {
                *value = confidence.pixels()[source] / 2;
            }
        }
        (take(&filled, &columns), result)
    }
}

/// Fills each pixel without a disparity from the nearest disparities before and after it in its row, or in its column if not
/// `along_rows`: it takes the smaller one, that of the background. A line without any disparity stays as it is.
pub(in crate::stereo) fn fill_lines(map: &DisparityMap, along_rows: bool) -> DisparityMap {
    take(map, &sources(map, along_rows))
}

/// The map in which each pixel has the disparity of its source.
fn take(map: &DisparityMap, sources: &[Option<usize>]) -> DisparityMap {
    let pixels = sources.iter().map(|source| source.and_then(|i| map.pixels()[i])).collect();
    DisparityMap::new(map.width(), map.height(), pixels)
}

/// The pixel from which each takes its disparity, itself if it has one. Pixels of a line without any have none.
fn sources(map: &DisparityMap, along_rows: bool) -> Vec<Option<usize>> {
    let [width, height] = [map.width(), map.height()];
    let pixels = map.pixels();
    let (lines, length) = if along_rows { (height, width) } else { (width, height) };
    let index = |line: usize, i: usize| if along_rows { line * width + i } else { i * width + line };
    let mut sources = vec![None; pixels.len()];
    for line in 0..lines {
        let mut before = None;
        let mut i = 0;
        while i < length {
            let end = (i..length).find(|&i| pixels[index(line, i)].is_some()).unwrap_or(length);
            let after = (end < length).then(|| index(line, end));
            let source = before.into_iter().chain(after).min_by_key(|&source: &usize| pixels[source]);
            (i..end).for_each(|i| sources[index(line, i)] = source);
            if let Some(after) = after {
                sources[after] = Some(after);
            }
            before = after;
            i = end + 1;
        }
    }
    sources
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Disparity;

    use super::*;

    /// A map and the confidence of a picture of digits, where `.` is an invalid pixel.
    fn map(rows: &[&str]) -> DisparityMap {
        let pixel = |digit: u8| if digit == b'.' { None } else { Disparity::from_bits(64 * i16::from(digit - b'0')) };
        Raster::new(rows[0].len(), rows.len(), rows.iter().flat_map(|row| row.bytes()).map(pixel).collect())
    }

    #[test]
    fn holes_take_the_farther_side() {
        let rows = ["7..3", "..5.", "....", "1.9.", "...."];
        let confidence = Raster::new(4, 5, (0..20).map(|i| 100 + 5 * i).collect());
        let (filled, sure) = BackgroundFill.apply(&map(&rows), &confidence);
        assert_eq!(filled, map(&["7333", "5555", "1155", "1199", "1199"]));
        // Pixels 0, 3, 6, 12 and 14 are the map's own, with 100, 115, 130, 160 and 170.
        let expected = [[100, 57, 57, 115], [65, 65, 130, 65], [80, 80, 65, 65], [160, 80, 170, 85], [80, 80, 85, 85]].concat();
        assert_eq!(sure.pixels(), expected);
    }

    #[test]
    fn without_disparities_nothing_changes() {
        let (empty, confidence) = (map(&["..", ".."]), Raster::filled(2, 2, 9));
        assert_eq!(BackgroundFill.apply(&empty, &confidence), (empty.clone(), confidence));
        assert_eq!(fill_lines(&map(&["3.", ".."]), false), map(&["3.", "3."]));
    }
}
