//! Occlusions of stereo: what the only neighbour does not see, filled from the background.

use multiscopic_core::{Disparity, View};

use super::smoother::Smoother;
use crate::images::{DisparityMap, Raster};

/// Fills what the only view does not see, beside nearer surfaces and at the border of the image, with the disparity of the
/// background.
///
/// Pixels are holes if their confidence is at most [`most_unsure`](OcclusionFill::most_unsure), or if a surer pixel of another
/// disparity has the same match. Along a line that the view moves the matches on, a nearer surface hides as many pixels behind
/// it as its disparity is greater than that in front of the hole. So many of the hole, next to the nearer surface, become
/// background. The rest of the hole stays as it is: the view sees it. At the side where matches leave the image, nothing tells
/// what is hidden, and the surface inside goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OcclusionFill {
    /// The greatest confidence of a hole.
    pub most_unsure: u8,
}

/// Pixels by which more is filled than is hidden. Nearer surfaces come out too wide, by about so much.
const SLACK: usize = 2;

impl Default for OcclusionFill {
    /// Holes are more probably wrong than right.
    fn default() -> OcclusionFill {
        OcclusionFill { most_unsure: Smoother::MOST_REPLACED }
    }
}

impl OcclusionFill {
    /// After the network, which is often right where it is unsure: a third.
    pub const NETWORK: OcclusionFill = OcclusionFill { most_unsure: 85 };

    /// The name on command lines.
    pub const NAME: &str = "background";

    /// The filled map and its confidence. A filled pixel has half the confidence of the one whose disparity it took. Invalid
    /// pixels stay invalid, and everything stays as it is if `view` is neither in the row nor in the column of the centre.
    ///
    /// # Panics
    /// If the sizes of the two differ.
    pub fn apply(self, map: &DisparityMap, confidence: &Raster<u8>, view: View) -> (DisparityMap, Raster<u8>) {
        let [width, height] = [map.width(), map.height()];
        assert_eq!([confidence.width(), confidence.height()], [width, height], "the size of the confidence");
        let (mut filled, mut sure) = (map.clone(), confidence.clone());
        let (lines, length, multiple) = match view {
            _ if view.is_horizontal() => (height, width, view.right()),
            _ if view.is_vertical() => (width, height, view.down()),
            _ => return (filled, sure),
        };
        for place in 0..lines {
            // In the order in which the matches are before the pixels.
            let index = |i: usize| {
                let i = if multiple > 0 { i } else { length - 1 - i };
                if view.is_horizontal() { place * width + i } else { i * width + place }
            };
            let pixels: Vec<_> = (0..length).map(index).map(|i| (map.pixels()[i], confidence.pixels()[i])).collect();
            let line = Line { pixels: &pixels, multiple: multiple.unsigned_abs().into(), most_unsure: self.most_unsure };
            for (i, source) in line.sources() {
                filled.pixels_mut()[index(i)] = pixels[source].0;
                sure.pixels_mut()[index(i)] = pixels[source].1 / 2;
            }
        }
        (filled, sure)
    }
}

/// A line of disparities and confidences. The match of pixel `i` with disparity `d` is at `i - multiple * d`.
struct Line<'a> {
    pixels: &'a [(Option<Disparity>, u8)],
    multiple: i32,
    most_unsure: u8,
}

impl Line<'_> {
    /// The pixels that are filled, each with the one whose disparity it takes.
    fn sources(&self) -> Vec<(usize, usize)> {
        let holes = self.holes();
        let length = holes.len();
        let mut sources = Vec::new();
        let mut start = 0;
        while start < length {
            let end = (start..length).find(|&i| !holes[i]).unwrap_or(length);
            let background = start.checked_sub(1);
            if end > start && end < length {
                let behind = self.shift(end) - background.map_or(0, |i| self.shift(i));
                let most = if behind > 0 { (behind as usize).div_ceil(Disparity::STEPS as usize) + SLACK } else { 0 };
                let hidden = match background {
                    Some(_) if behind <= self.multiple * Disparity::STEPS => start..start,
                    Some(_) => start.max(end.saturating_sub(most))..end,
                    None => start..end.min(most),
                };
                let valid = hidden.filter(|&i| self.pixels[i].0.is_some());
                sources.extend(valid.map(|i| (i, background.unwrap_or(end))));
            }
            start = end + 1;
        }
        sources
    }

    /// True of pixels that are invalid, unsure, or lose their match to a surer one.
    fn holes(&self) -> Vec<bool> {
        let claim = |i: usize| (self.pixels[i].1, self.pixels[i].0);
        let mut owners: Vec<Option<usize>> = vec![None; self.pixels.len()];
        for i in 0..self.pixels.len() {
            if let Some(place) = self.place(i)
                && owners[place].is_none_or(|owner| claim(owner) <= claim(i))
            {
                owners[place] = Some(i);
            }
        }
        let is_lost = |i: usize| {
            let owner = self.place(i).and_then(|place| owners[place]);
            owner.is_some_and(|owner| (self.shift(owner) - self.shift(i)).abs() > self.multiple * Disparity::STEPS)
        };
        let is_hole = |i: usize| {
            let (disparity, confidence) = self.pixels[i];
            disparity.is_none() || confidence <= self.most_unsure || is_lost(i)
        };
        (0..self.pixels.len()).map(is_hole).collect()
    }

    /// The distance of the match of a valid pixel, in steps.
    fn shift(&self, i: usize) -> i32 {
        self.pixels[i].0.map_or(0, |d| self.multiple * i32::from(d.to_bits()))
    }

    /// The pixel that the match of a valid pixel is in, if that is on the line.
    fn place(&self, i: usize) -> Option<usize> {
        self.pixels[i].0?;
        let shift = (self.shift(i) + Disparity::STEPS / 2).div_euclid(Disparity::STEPS);
        let place = usize::try_from(i as i32 - shift).ok()?;
        (place < self.pixels.len()).then_some(place)
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::View;

    use super::*;

    /// Digits are disparities, `.` is invalid.
    fn row(digits: &str) -> DisparityMap {
        let pixel = |digit: u8| if digit == b'.' { None } else { Disparity::whole(i16::from(digit - b'0')) };
        Raster::new(digits.len(), 1, digits.bytes().map(pixel).collect())
    }

    /// The disparities filled where `unsure` has a `?`.
    fn filled(digits: &str, unsure: &str, view: View) -> (DisparityMap, Raster<u8>) {
        let sure = unsure.bytes().map(|letter| if letter == b'?' { 100 } else { 200 }).collect();
        OcclusionFill::default().apply(&row(digits), &Raster::new(digits.len(), 1, sure), view)
    }

    #[test]
    fn what_is_hidden_becomes_background() {
        // Three pixels are hidden, and two more are filled; the view sees the first of the hole.
        let (map, sure) = filled("11111333333444444", "     ??????      ", View::RIGHT);
        assert_eq!(map, row("11111311111444444"));
        assert_eq!(sure.pixels()[4..11], [200, 100, 100, 100, 100, 100, 100]);
        // The same, seen from the other side.
        assert_eq!(filled("44444433333311111", "      ??????     ", View::LEFT).0, row("44444411111311111"));
        // Behind a farther surface nothing is hidden.
        assert_eq!(filled("44444433333311111", "      ??????     ", View::RIGHT).0, row("44444433333311111"));
        assert_eq!(filled("44444..333311111", "    ??????      ", View::RIGHT).0, row("44444..333311111"));
    }

    #[test]
    fn surfaces_go_on_beyond_what_the_view_sees() {
        assert_eq!(filled("0102222222", "????      ", View::RIGHT).0, row("2222222222"));
        assert_eq!(filled("01022222", "????    ", View::LEFT).0, row("01022222"));
        // Without anything sure there is nothing to go on.
        assert_eq!(filled("0102", "????", View::RIGHT).0, row("0102"));
    }

    #[test]
    fn the_surer_of_two_pixels_has_the_match() {
        // The matches of columns 5, 6 and 8 are all in column 4, and those of columns 4 and 7 in column 3.
        let confidence = Raster::new(20, 1, (0..20).map(|i| if i == 6 { 150 } else { 200 }).collect());
        let map = OcclusionFill::default().apply(&row("11111124444444444444"), &confidence, View::RIGHT).0;
        assert_eq!(map, row("11111114444444444444"));
    }
}
