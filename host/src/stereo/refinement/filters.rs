//! Filters of disparity maps: the median and the bilateral filter over windows, in which invalid pixels stay invalid and never
//! count, and one that fills invalid pixels from the background beside them.

use multiscopic_core::Disparity;
use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Raster},
};

/// A median filter over a square window. Invalid pixels stay invalid and never count; of an even number of
/// disparities it takes the upper median.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Median {
    radius: usize,
}

impl Median {
    /// The largest window, 31 x 31 pixels.
    pub const MAX_SIZE: u8 = 31;

    /// With a window of `size` x `size` pixels.
    ///
    /// # Errors
    /// If the size is not odd and from 3 to [`MAX_SIZE`](Median::MAX_SIZE).
    pub fn new(size: u8) -> Result<Median> {
        let largest = Median::MAX_SIZE;
        match size {
            3..=Median::MAX_SIZE if size % 2 == 1 => Ok(Median::of_radius(size as usize / 2)),
            _ => Err(Error::Usage(format!("the size of the median filter is {size}, it must be odd and from 3 to {largest}"))),
        }
    }

    /// With a window that reaches `radius` pixels to each side.
    pub(in crate::stereo) const fn of_radius(radius: usize) -> Median {
        Median { radius }
    }

    /// The side of the window in pixels.
    pub const fn size(self) -> u8 {
        2 * self.radius as u8 + 1
    }

    /// The filtered map, computed on the threads of the current pool.
    pub fn apply(self, map: &DisparityMap) -> DisparityMap {
        let (width, height, radius) = (map.width(), map.height(), self.radius);
        let mut filtered = map.clone();
        filtered.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each_init(Histogram::new, |histogram, (v, line)| {
            let rows = v.saturating_sub(radius)..height.min(v + radius + 1);
            let column = |x: usize| rows.clone().filter_map(move |y| map.get(x, y));
            (0..width.min(radius)).flat_map(column).for_each(|d| histogram.add(d));
            for (u, pixel) in line.iter_mut().enumerate() {
                (u + radius < width).then(|| column(u + radius)).into_iter().flatten().for_each(|d| histogram.add(d));
                (u > radius).then(|| column(u - radius - 1)).into_iter().flatten().for_each(|d| histogram.remove(d));
                *pixel = pixel.and_then(|_| histogram.upper_median());
            }
            (width.saturating_sub(radius + 1)..width).flat_map(column).for_each(|d| histogram.remove(d));
        });
        filtered
    }
}

/// The number of times that each disparity occurs in a window, and the same for all that share the upper half of their bits.
struct Histogram {
    fine: Vec<u16>,
    coarse: [u16; 256],
    count: u16,
}

impl Histogram {
    fn new() -> Histogram {
        Histogram { fine: vec![0; 1 << 16], coarse: [0; 256], count: 0 }
    }

    fn add(&mut self, d: Disparity) {
        let raw = usize::from(Disparity::to_raw16(Some(d)));
        self.fine[raw] += 1;
        self.coarse[raw >> 8] += 1;
        self.count += 1;
    }

    fn remove(&mut self, d: Disparity) {
        let raw = usize::from(Disparity::to_raw16(Some(d)));
        self.fine[raw] -= 1;
        self.coarse[raw >> 8] -= 1;
        self.count -= 1;
    }

    /// The least disparity above which there are fewer than half.
    fn upper_median(&self) -> Option<Disparity> {
        let mut rest = self.count / 2;
        let mut place = |counts: &[u16]| {
            counts.iter().position(|&count| {
                let is_here = rest < count;
                rest -= if is_here { 0 } else { count };
                is_here
            })
        };
        let upper = place(&self.coarse)?;
        let lower = place(&self.fine[upper << 8..(upper + 1) << 8])?;
        Disparity::from_raw16((upper << 8 | lower) as u16)
    }
}

/// A bilateral filter: the mean of the disparities in a window that differ from the middle one by less than a
/// threshold, weighted by a Gaussian of their distance (Žbontar and LeCun 2016, section 4.4). The window ends
/// at three standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilateral {
    sigma: f64,
    threshold: f64,
}

impl Bilateral {
    /// The published values of the fast network on Middlebury.
    pub const FAST: Bilateral = Bilateral { sigma: 6.0, threshold: 2.0 };
    /// The published values of the accurate network on Middlebury.
    pub const ACCURATE: Bilateral = Bilateral { sigma: 1.67, threshold: 2.0 };

    /// A filter with a standard deviation of `sigma` pixels, and a threshold in pixels of disparity.
    ///
    /// # Errors
    /// If `sigma` is not above 0 and at most 20, or the threshold not above 0.
    pub fn new(sigma: f64, threshold: f64) -> Result<Bilateral> {
        if !(sigma > 0.0 && sigma <= 20.0 && threshold > 0.0) {
            let found = format!("the bilateral filter has sigma {sigma} and threshold {threshold}");
            return Err(Error::Usage(format!("{found}, sigma must be above 0 and at most 20, the threshold above 0")));
        }
        Ok(Bilateral { sigma, threshold })
    }

    /// The filtered map, computed on the threads of the current pool.
    pub fn apply(self, map: &DisparityMap) -> DisparityMap {
        let radius = (3.0 * self.sigma).ceil() as usize;
        let falloff = |distance: usize| (-((distance * distance) as f64) / (2.0 * self.sigma * self.sigma)).exp();
        let weights: Vec<f64> = (0..=radius).map(falloff).collect();
        let threshold = self.threshold * f64::from(Disparity::STEPS);
        filter_valid(map, |u, v, center| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (x, y, d) in valid_in_window(map, u, v, radius) {
                let difference = f64::from(d.to_bits()) - f64::from(center.to_bits());
                if difference.abs() < threshold {
                    let weight = weights[x.abs_diff(u)] * weights[y.abs_diff(v)];
                    sum += weight * difference;
                    total += weight;
                }
            }
            Disparity::from_bits((f64::from(center.to_bits()) + sum / total).round() as i16)
        })
    }
}

/// The map with each valid pixel replaced by what `filter` makes of its column, row and disparity.
fn filter_valid(map: &DisparityMap, filter: impl Fn(usize, usize, Disparity) -> Option<Disparity> + Sync) -> DisparityMap {
    let width = map.width();
    let pixels = map.pixels().par_iter().enumerate();
    let pixels = pixels.map(|(i, pixel)| pixel.and_then(|d| filter(i % width, i / width, d))).collect();
    Raster::new(width, map.height(), pixels)
}

/// The valid pixels in the window of `radius` around `(u, v)`: column, row and disparity.
fn valid_in_window(map: &DisparityMap, u: usize, v: usize, radius: usize) -> impl Iterator<Item = (usize, usize, Disparity)> {
    let columns = u.saturating_sub(radius)..map.width().min(u + radius + 1);
    let rows = v.saturating_sub(radius)..map.height().min(v + radius + 1);
    rows.flat_map(move |y| columns.clone().filter_map(move |x| Some((x, y, map.get(x, y)?))))
}

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
    use super::*;

    fn map(width: usize, bits: &[i16]) -> DisparityMap {
        // -1 stands for none.
        let pixel = |&bits: &i16| if bits < 0 { None } else { Disparity::from_bits(bits) };
        Raster::new(width, bits.len() / width, bits.iter().map(pixel).collect())
    }

    #[test]
    fn takes_the_median_of_valid_pixels() {
        let found = Median::new(3).unwrap().apply(&map(3, &[9, 1, 2, -1, 90, 3, 4, 5, -1]));
        // The middle has 1 2 3 4 5 9 90; the first 1 9 90; the last of the first row 1 2 3 90.
        assert_eq!(found, map(3, &[9, 3, 3, -1, 4, 3, 5, 5, -1]));
        assert!([0, 1, 4, 32, 33].into_iter().all(|size| Median::new(size).is_err()));
    }

    #[test]
    fn equals_the_sorted_window() {
        let mut random = 1_u32;
        let mut below = |limit: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % limit
        };
        for _ in 0..60 {
            let (width, height, size) = (1 + below(30) as usize, 1 + below(12) as usize, 3 + 2 * below(15) as u8);
            let levels = [4, 3000][below(2) as usize];
            let bits: Vec<i16> = (0..width * height).map(|_| if below(5) == 0 { -1 } else { below(levels) as i16 }).collect();
            let radius = usize::from(size) / 2;
            let expected: Vec<i16> = (0..width * height)
                .map(|i| {
                    let (u, v) = (i % width, i / width);
                    let near = |&j: &usize| (j % width).abs_diff(u) <= radius && (j / width).abs_diff(v) <= radius;
                    let mut window: Vec<i16> = (0..bits.len()).filter(near).map(|j| bits[j]).filter(|&d| d >= 0).collect();
                    window.sort_unstable();
                    if bits[i] < 0 { -1 } else { window[window.len() / 2] }
                })
                .collect();
            assert_eq!(Median::new(size).unwrap().apply(&map(width, &bits)), map(width, &expected), "{width}x{height}, {size}");
        }
    }

    #[test]
    fn bilateral_keeps_edges() {
        let bilateral = Bilateral::new(1.0, 2.0).unwrap();
        let flat = map(4, &[640; 12]);
        assert_eq!(bilateral.apply(&flat), flat);
        let edge = map(4, &[64, 64, 192, 192, 64, 64, 192, 192]);
        assert_eq!(bilateral.apply(&edge), edge, "a difference of two pixels is not below the threshold");
        // Two pixels a distance of 1 apart: the weight of the other is e^(-1/2), so that a share of 0.3775 of
        // 100 comes over.
        assert_eq!(bilateral.apply(&map(2, &[100, 200])), map(2, &[138, 162]));
        assert!(Bilateral::new(0.0, 1.0).is_err() && Bilateral::new(1.0, f64::NAN).is_err());
    }

    /// A map of digits, where `.` is an invalid pixel.
    fn digits(rows: &[&str]) -> DisparityMap {
        let pixel = |digit: u8| if digit == b'.' { None } else { Disparity::from_bits(64 * i16::from(digit - b'0')) };
        Raster::new(rows[0].len(), rows.len(), rows.iter().flat_map(|row| row.bytes()).map(pixel).collect())
    }

    #[test]
    fn holes_take_the_farther_side() {
        let rows = ["7..3", "..5.", "....", "1.9.", "...."];
        let confidence = Raster::new(4, 5, (0..20).map(|i| 100 + 5 * i).collect());
        let (filled, sure) = BackgroundFill.apply(&digits(&rows), &confidence);
        assert_eq!(filled, digits(&["7333", "5555", "1155", "1199", "1199"]));
        // Pixels 0, 3, 6, 12 and 14 are the map's own, with 100, 115, 130, 160 and 170.
        let expected = [[100, 57, 57, 115], [65, 65, 130, 65], [80, 80, 65, 65], [160, 80, 170, 85], [80, 80, 85, 85]].concat();
        assert_eq!(sure.pixels(), expected);
    }

    #[test]
    fn without_disparities_nothing_changes() {
        let (empty, confidence) = (digits(&["..", ".."]), Raster::filled(2, 2, 9));
        assert_eq!(BackgroundFill.apply(&empty, &confidence), (empty.clone(), confidence));
        assert_eq!(fill_lines(&digits(&["3.", ".."]), false), digits(&["3.", "3."]));
    }
}
