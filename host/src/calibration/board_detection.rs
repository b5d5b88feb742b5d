//! Finding the corners of a board in an image.

use calib_targets_charuco::{CharucoDetector, CharucoParams, GrayImageView};
use calib_targets_chessboard::{ChessboardDetector, ChessboardParams, default_chess_config, detect_corners};
use image::{
    GrayImage,
    imageops::{self, FilterType},
};

use super::{blur::is_blurred, printed_board::PrintedBoard, subpixel};

/// A corner of the board that an image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCorner {
    /// Its place on the board in millimetres, from a corner of the board.
    pub board_mm: [f64; 2],
    /// Its place in the image in pixels.
    pub pixel: [f64; 2],
}

/// Why an image does not help.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardMiss {
    /// No board is seen.
    #[error("no board is found: show the whole board, near and in good light, or correct --board, --squares and --dictionary")]
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
        "a chessboard with {}x{} corners is seen, but one of {}x{} squares has {}x{}: correct --squares",
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
    /// A chessboard may be seen in part: which of its corners are seen is then unknown, and a place on the board is right up to a
    /// motion of the board in its plane, which does not matter to the calibration of a lens.
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
        let seen = subpixel::refine(image, &seen, self.clear_share());
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

    /// How far from a corner the squares are plain, as a share of their side.
    fn clear_share(&self) -> f64 {
        self.markers().map_or(0.5, |markers| (1.0 - markers.side_mm / self.square_mm()) / 2.0)
    }
}
