//! The features of pixels.

use std::ops::Range;

/// The features of the pixels of some rows of an image: `channels` values for each, which describe the patch
/// around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    width: usize,
    channels: usize,
    rows: Range<usize>,
    /// Row by row, and within a row pixel by pixel.
    values: Vec<f32>,
}

impl Features {
    /// The features of `rows`, row by row and pixel by pixel.
    ///
    /// # Panics
    /// If `values` has another length than `rows.len() * width * channels`.
    pub(super) fn new(width: usize, channels: usize, rows: Range<usize>, values: Vec<f32>) -> Features {
        assert_eq!(values.len(), rows.len() * width * channels, "the features of {rows:?}");
        Features { width, channels, rows, values }
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Values for each pixel.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The rows of the image that have features here.
    pub fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// The features of row `v`, pixel by pixel.
    ///
    /// # Panics
    /// If the row has none here.
    pub fn row(&self, v: usize) -> &[f32] {
        assert!(self.rows.contains(&v), "row {v} of {:?}", self.rows);
        let length = self.width * self.channels;
        &self.values[(v - self.rows.start) * length..][..length]
    }

    /// The features of the pixel in column `u` of row `v`.
    ///
    /// # Panics
    /// If the pixel has none here.
    pub fn pixel(&self, u: usize, v: usize) -> &[f32] {
        &self.row(v)[u * self.channels..][..self.channels]
    }

    /// Moves on to `rows`: drops the features of other rows, and gets those that are missing from `more`.
    pub(super) fn advance(&mut self, rows: Range<usize>, more: impl FnOnce(Range<usize>) -> Features) {
        let kept = if self.rows.contains(&rows.start) { self.rows.end } else { rows.start };
        let length = self.width * self.channels;
        self.values.drain(..self.values.len() - (kept - rows.start) * length);
        self.values.truncate(rows.len() * length);
        if kept < rows.end {
            self.values.extend(more(kept..rows.end).values);
        }
        self.rows = rows;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of two pixels with three channels. Each value tells its row and position.
    fn features(rows: Range<usize>) -> Features {
        let values = rows.clone().flat_map(|v| (0..6).map(move |i| (10 * v + i) as f32)).collect();
        Features::new(2, 3, rows, values)
    }

    #[test]
    fn pixels_in_rows() {
        let features = features(4..7);
        assert_eq!(features.row(5), [50.0, 51.0, 52.0, 53.0, 54.0, 55.0]);
        assert_eq!(features.pixel(1, 6), [63.0, 64.0, 65.0]);
        assert_eq!((features.width(), features.channels(), features.rows()), (2, 3, 4..7));
    }

    #[test]
    fn advancing_computes_only_missing_rows() {
        for (from, to, made) in [
            (2..5, 3..8, 5..8),
            (2..5, 2..5, 0..0),
            (2..5, 7..9, 7..9),
            (2..5, 5..6, 5..6),
            (4..6, 1..5, 1..5),
            (0..0, 0..3, 0..3),
            (2..8, 3..5, 0..0),
        ] {
            let mut current = features(from.clone());
            let mut asked = 0..0;
            current.advance(to.clone(), |rows| {
                asked = rows.clone();
                features(rows)
            });
            assert_eq!((current, asked), (features(to), made), "{from:?}");
        }
    }
}
