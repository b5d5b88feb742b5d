//! Finding the corners of a board in an image.

use std::collections::BTreeMap;

use calib_targets_charuco::{CharucoDetector, CharucoParams, GrayImageView};
use calib_targets_chessboard::{ChessboardDetector, ChessboardParams, default_chess_config, detect_corners};
use image::{
    GrayImage,
    imageops::{self, FilterType},
};
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::printed_board::PrintedBoard;

/// A corner of the board that an image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCorner {
    /// Its place on the board in millimetres, from a corner of the board.
    pub board_mm: [f64; 2],
    /// Its place in the image in pixels.
    pub pixel: [f64; 2],
}

/// The reason why an image does not help.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardMiss {
    /// No board is seen.
    #[error(
        "no board is found: show the whole board, near and in good light, or correct the kind of board, its squares and its dictionary"
    )]
    NotFound,
    /// Edges are spread over several pixels, or a board is seen only after the image is scaled down.
    #[error("the picture is blurred: hold camera and board still, focus, and use more light")]
    Blurred,
    /// The board is seen only after the image is flipped.
    #[error("the board is mirrored: switch off the mirror image of the camera")]
    Mirrored,
    /// The board is seen, but too little of it.
    #[error(
        "only {found} of the board's {count} corners are seen, {LEAST_CORNERS} are needed: move the whole board into view, and nearer"
    )]
    TooFew {
        /// The number of corners seen.
        found: usize,
        /// The number of corners of the board.
        count: usize,
    },
    /// The image shows more of a chessboard than there should be.
    #[error(
        "a chessboard with {}x{} corners is seen, but one of {}x{} squares has {}x{}: correct the number of squares",
        found[0], found[1], squares[0], squares[1], squares[0] - 1, squares[1] - 1
    )]
    Larger {
        /// The corners seen in a row and in a column.
        found: [u32; 2],
        /// The squares of the board.
        squares: [u32; 2],
    },
}

/// The least number of corners for an image to help.
pub const LEAST_CORNERS: usize = 8;

impl PrintedBoard {
    /// The corners that an image shows, to a few hundredths of a pixel.
    ///
    /// A chessboard may be seen in part: which of its corners are seen is then unknown, and a place on the board is right up to
    /// a motion of the board in its plane, which does not matter to the calibration of a lens.
    ///
    /// # Errors
    /// [`BoardMiss`] says what is wrong with the image.
    pub fn corners_in(&self, image: &GrayImage) -> Result<Vec<BoardCorner>, BoardMiss> {
        match self.find(image) {
            Ok(None) => {}
            Ok(Some(corners)) => return Ok(corners),
            Err(BoardMiss::TooFew { .. }) if is_blurred(image) => return Err(BoardMiss::Blurred),
            Err(miss) => return Err(miss),
        }
        if self.markers().is_some() && !matches!(self.find(&imageops::flip_horizontal(image)), Ok(None)) {
            return Err(BoardMiss::Mirrored);
        }
        let [mut width, mut height] = [image.width(), image.height()];
        let mut scaled = image.clone();
        while width.min(height) >= 240 {
            (width, height) = (width / 2, height / 2);
            scaled = imageops::resize(&scaled, width, height, FilterType::Triangle);
            if !matches!(self.find(&scaled), Ok(None)) {
                return Err(BoardMiss::Blurred);
            }
        }
        Err(if is_blurred(image) { BoardMiss::Blurred } else { BoardMiss::NotFound })
    }

    /// The corners, if there are any.
    fn find(&self, image: &GrayImage) -> Result<Option<Vec<BoardCorner>>, BoardMiss> {
        let view = GrayImageView { width: image.width() as usize, height: image.height() as usize, data: image.as_raw() };
        let seen: Vec<([u32; 2], [f64; 2])> = match self.markers() {
            Some(markers) => {
                let detector =
                    CharucoDetector::new(CharucoParams::for_board(markers.board.spec())).expect("the board was checked");
                let across = self.squares()[0] - 1;
                let found = detector.detect(&view).map(|detection| detection.corners).unwrap_or_default();
                let place = |id: u32| [id % across + 1, id / across + 1];
                found.iter().map(|corner| (place(corner.id), [corner.position.x, corner.position.y].map(f64::from))).collect()
            }
            None => {
                let detector = ChessboardDetector::new(ChessboardParams::default()).expect("the default is valid");
                let detection = detector.detect(&detect_corners(&view, &default_chess_config()));
                let found = detection.map(|detection| detection.corners).unwrap_or_default();
                let place = |corner: [i32; 2]| corner.map(|index| index.max(0) as u32 + 1);
                let corners = found
                    .iter()
                    .map(|corner| (place([corner.grid.u, corner.grid.v]), [corner.position.x, corner.position.y].map(f64::from)));
                corners.collect()
            }
        };
        if seen.is_empty() {
            return Ok(None);
        }
        let squares = self.squares();
        let found = [0, 1].map(|axis| seen.iter().map(|(place, _)| place[axis]).max().unwrap_or_default());
        // A chessboard may be turned by a quarter.
        let fits = |squares: [u32; 2]| found.iter().zip(squares).all(|(found, squares)| *found < squares);
        if !fits(squares) && !fits([squares[1], squares[0]]) {
            return Err(BoardMiss::Larger { found, squares });
        }
        let seen = refine(image, &seen, self.clear_share());
        let is_in_a_row = |axis: usize| seen.iter().all(|(place, _)| place[axis] == seen[0].0[axis]);
        if seen.len() < LEAST_CORNERS || is_in_a_row(0) || is_in_a_row(1) {
            return Err(BoardMiss::TooFew { found: seen.len(), count: self.corner_count() });
        }
        let corner = |&(place, pixel): &([u32; 2], [f64; 2])| BoardCorner {
            board_mm: place.map(|index| f64::from(index) * self.square_mm()),
            pixel,
        };
        Ok(Some(seen.iter().map(corner).collect()))
    }

    /// The distance from a corner up to which the squares are plain, as a share of their side.
    fn clear_share(&self) -> f64 {
        self.markers().map_or(0.5, |markers| (1.0 - markers.side_mm / self.square_mm()) / 2.0)
    }
}

/// The largest and smallest half side of the window around a corner, in pixels.
const LARGEST_WINDOW: f64 = 8.0;
const SMALLEST_WINDOW: f64 = 2.0;
/// A refined corner may lie this far from where it was found, in pixels. Otherwise it is dropped.
const FARTHEST: f64 = 1.5;
const MAX_STEPS: usize = 30;

/// A corner: its place in the grid, and where it is in the image.
type GridCorner = ([u32; 2], [f64; 2]);

/// Moves each corner to the point that all edges around it lead to (Förstner and Gülch, 1987): the vector from it to an edge
/// is perpendicular to the gradient there. Drops those that have no such point nearby.
///
/// The window around a corner ends where the squares are no longer plain, at the share `clear` of their side.
pub fn refine(image: &GrayImage, corners: &[GridCorner], clear: f64) -> Vec<GridCorner> {
    let places: BTreeMap<[u32; 2], [f64; 2]> = corners.iter().copied().collect();
    let refined = |&(place, pixel): &GridCorner| {
        let [column, row] = place;
        let neighbors = [[column + 1, row], [column.wrapping_sub(1), row], [column, row + 1], [column, row.wrapping_sub(1)]];
        let distances = neighbors.iter().filter_map(|place| places.get(place)).map(|[u, v]| (u - pixel[0]).hypot(v - pixel[1]));
        let side = distances.min_by(f64::total_cmp)?;
        let window = (clear * side).clamp(SMALLEST_WINDOW, LARGEST_WINDOW).floor() as i32;
        Some((place, saddle(image, pixel, window)?))
    };
    corners.par_iter().filter_map(refined).collect()
}

fn saddle(image: &GrayImage, start: [f64; 2], window: i32) -> Option<[f64; 2]> {
    let start = Vector2::from(start);
    let mut at = start;
    let side = (2 * window + 3) as usize;
    let mut patch = vec![0.0; side * side];
    for _ in 0..MAX_STEPS {
        for (k, gray) in patch.iter_mut().enumerate() {
            let offset = |k: usize| k as f64 - f64::from(window) - 1.0;
            *gray = sample(image, at.x + offset(k % side), at.y + offset(k / side))?;
        }
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for row in 1..side - 1 {
            for column in 1..side - 1 {
                let k = row * side + column;
                let gradient = Vector2::new(patch[k + 1] - patch[k - 1], patch[k + side] - patch[k - side]);
                let offset = Vector2::new(column as f64, row as f64) - Vector2::repeat(f64::from(window) + 1.0);
                let distance = offset.norm() / f64::from(window);
                let tensor = gradient * gradient.transpose() * (-distance * distance).exp();
                matrix += tensor;
                right += tensor * offset;
            }
        }
        let step = matrix.try_inverse()? * right;
        at += step;
        if (at - start).norm() > FARTHEST {
            return None;
        }
        if step.norm() < 1e-3 {
            return Some(at.into());
        }
    }
    None
}

/// The grey value between pixels, by a quadratic B-spline: it smooths edges that are sharper than pixels can show, which would
/// draw corners towards pixels. `None` at the border of the image.
fn sample(image: &GrayImage, u: f64, v: f64) -> Option<f64> {
    let (column, row) = (u.round(), v.round());
    let inside = column >= 1.0 && row >= 1.0 && column + 1.0 < f64::from(image.width()) && row + 1.0 < f64::from(image.height());
    if !inside {
        return None;
    }
    let weights = |t: f64| [(0.5 - t) * (0.5 - t) / 2.0, 0.75 - t * t, (0.5 + t) * (0.5 + t) / 2.0];
    let gray = |du: u32, dv: u32| f64::from(image.get_pixel(column as u32 + du - 1, row as u32 + dv - 1).0[0]);
    let across = weights(u - column);
    let of_row = |dv: u32| (0..3).zip(across).map(|(du, weight)| weight * gray(du, dv)).sum::<f64>();
    Some((0..3).zip(weights(v - row)).map(|(dv, weight)| weight * of_row(dv)).sum())
}

/// The distance between the pixels of a long difference: more than the width of any edge that is sharp enough.
const LONG: usize = 12;
/// The share of the pixels that the strongest edges pass through.
const STRONGEST: f64 = 0.0005;
/// The least share of an edge's contrast that lies between two neighbouring pixels: that of an edge blurred with a standard
/// deviation of 2 pixels.
const LEAST_SHARE: f64 = 0.2;
/// The least contrast of edges that tell anything, in grey values.
const LEAST_CONTRAST: u8 = 20;

/// Returns true if even the strongest edges of a picture, down or across, are spread over several pixels. A picture without
/// edges is not blurred.
pub fn is_blurred(image: &GrayImage) -> bool {
    [[1, 0], [0, 1]].into_iter().any(|step: [usize; 2]| {
        let [short, long] = [1, LONG].map(|distance| strongest(image, step, distance));
        long >= LEAST_CONTRAST && f64::from(short) < LEAST_SHARE * f64::from(long)
    })
}

/// The difference between pixels at the strongest edges, over a distance in steps to the right or down. As many pairs of pixels
/// lie across an edge as the distance has steps.
fn strongest(image: &GrayImage, [right, down]: [usize; 2], distance: usize) -> u8 {
    let (width, pixels) = (image.width() as usize, image.as_raw());
    let mut counts = [0_usize; 256];
    for (row, other) in pixels.chunks_exact(width).zip(pixels.chunks_exact(width).skip(down * distance)) {
        let pairs = row.iter().zip(other.iter().skip(right * distance));
        pairs.for_each(|(a, b)| counts[usize::from(a.abs_diff(*b))] += 1);
    }
    let mut left = (STRONGEST * (pixels.len() * distance) as f64) as usize;
    for difference in (0..=255).rev() {
        match left.checked_sub(counts[usize::from(difference)]) {
            Some(rest) => left = rest,
            None => return difference,
        }
    }
    0
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Luma, imageops};

    #[test]
    fn edges_tell_how_blurred_a_picture_is() {
        let mut random = fastrand::Rng::with_seed(1);
        let mut noisy = |image: &GrayImage| {
            GrayImage::from_fn(200, 160, |u, v| Luma([image.get_pixel(u, v).0[0].saturating_add_signed(random.i8(-3..=3))]))
        };
        let squares = GrayImage::from_fn(200, 160, |u, v| Luma([if (u / 20 + v / 20) % 2 == 0 { 40 } else { 200 }]));
        for (deviation, expected) in [(0.5, false), (1.0, false), (1.6, false), (3.0, true), (5.0, true)] {
            let blurred = noisy(&imageops::blur(&squares, deviation));
            assert_eq!(is_blurred(&blurred), expected, "{deviation} pixels");
        }
        // Moved sideways while the picture was taken.
        let mean = |u: u32, v: u32| (0..12).map(|k| u32::from(squares.get_pixel((u + k).min(199), v).0[0])).sum::<u32>() / 12;
        assert!(is_blurred(&noisy(&GrayImage::from_fn(200, 160, |u, v| Luma([mean(u, v) as u8])))));
        // A few edges are enough.
        let few = GrayImage::from_fn(200, 160, |u, v| Luma([if u > 120 && v > 120 { 40 } else { 200 }]));
        assert!(!is_blurred(&noisy(&imageops::blur(&few, 1.0))) && is_blurred(&noisy(&imageops::blur(&few, 3.0))));
        assert!(!is_blurred(&noisy(&GrayImage::from_pixel(200, 160, Luma([99])))), "nothing but noise");
    }
}
