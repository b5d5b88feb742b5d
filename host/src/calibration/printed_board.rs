//! The boards that lenses are calibrated with.

use std::fmt;

use calib_targets_charuco::{CharucoBoard, CharucoBoardSpec, Dictionary, resolve_dictionary};

use crate::error::{Error, Result};

/// The least number of squares on each side: with fewer there are too few corners.
const LEAST_SQUARES: u32 = 3;
/// The largest number of squares on each side.
const MOST_SQUARES: u32 = 100;

/// A flat board of black and white squares, whose corners calibrate a lens.
///
/// The top left square is black. Positions on the board are in millimetres from its top left corner, to the right and down.
#[derive(Clone, Debug)]
pub struct PrintedBoard {
    columns: u32,
    rows: u32,
    square_mm: f64,
    markers: Option<Markers>,
}

/// The markers in the white squares of a ChArUco board, as OpenCV has placed them since version 4.6.
#[derive(Clone, Debug)]
pub(super) struct Markers {
    pub(super) side_mm: f64,
    pub(super) board: CharucoBoard,
}

/// A black rectangle: the left and top sides, width and height, in millimetres.
pub type Rectangle = [f64; 4];

impl PrintedBoard {
    /// A chessboard of `columns` x `rows` squares.
    ///
    /// # Errors
    /// [`Error::Usage`] if it has fewer than 3 or more than 100 squares on a side, or `square_mm` is not above 0.
    pub fn chessboard(columns: u32, rows: u32, square_mm: f64) -> Result<PrintedBoard> {
        let counts = LEAST_SQUARES..=MOST_SQUARES;
        if !counts.contains(&columns) || !counts.contains(&rows) {
            let message =
                format!("a board of {columns}x{rows} squares: it must have {LEAST_SQUARES} to {MOST_SQUARES} on each side");
            return Err(Error::Usage(message));
        }
        if !(square_mm > 0.0 && square_mm.is_finite()) {
            return Err(Error::Usage(format!("squares of {square_mm} mm: their side must be above 0")));
        }
        Ok(PrintedBoard { columns, rows, square_mm, markers: None })
    }

    /// A ChArUco board of `columns` x `rows` squares: a chessboard with a marker of side `marker_mm` in each white square. The
    /// markers are the first of a dictionary, which has OpenCV's name, such as `4X4_250` or `APRILTAG_36h11`.
    ///
    /// # Errors
    /// [`Error::Usage`] as for a chessboard, and if a marker does not fit into a square with a margin, or the dictionary is
    /// unknown or has too few markers.
    pub fn charuco(columns: u32, rows: u32, square_mm: f64, marker_mm: f64, dictionary: &str) -> Result<PrintedBoard> {
        let chessboard = PrintedBoard::chessboard(columns, rows, square_mm)?;
        let share = marker_mm / square_mm;
        if !(0.3..=0.9).contains(&share) {
            let message =
                format!("markers of {marker_mm} mm in squares of {square_mm} mm: they must have 0.3 to 0.9 of the side");
            return Err(Error::Usage(message));
        }
        let Some(dictionary) = resolve_dictionary(dictionary) else {
            let message = format!("no dictionary is named {dictionary}: OpenCV's are 4X4_50, 5X5_100, APRILTAG_36h11 and so on");
            return Err(Error::Usage(message));
        };
        let spec = CharucoBoardSpec::new(rows, columns, square_mm as f32, share as f32, dictionary);
        let board = CharucoBoard::new(spec).map_err(|error| Error::Usage(format!("a board of {columns}x{rows}: {error}")))?;
        Ok(PrintedBoard { markers: Some(Markers { side_mm: marker_mm, board }), ..chessboard })
    }

    /// The number of squares in a row and in a column.
    pub fn squares(&self) -> [u32; 2] {
        [self.columns, self.rows]
    }

    /// The side of a square in millimetres.
    pub(crate) fn square_mm(&self) -> f64 {
        self.square_mm
    }

    /// Width and height in millimetres.
    pub fn size_mm(&self) -> [f64; 2] {
        self.squares().map(|count| f64::from(count) * self.square_mm)
    }

    /// The number of corners, which are where four squares meet.
    pub(crate) fn corner_count(&self) -> usize {
        ((self.columns - 1) * (self.rows - 1)) as usize
    }

    pub(super) fn markers(&self) -> Option<&Markers> {
        self.markers.as_ref()
    }

    /// All that is black, in rectangles that do not overlap.
    pub(crate) fn black_rectangles(&self) -> Vec<Rectangle> {
        let square = self.square_mm;
        let places = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        let black = places.filter(|(column, row)| (column + row) % 2 == 0);
        let mut rectangles: Vec<Rectangle> =
            black.map(|(column, row)| [f64::from(column) * square, f64::from(row) * square, square, square]).collect();
        if let Some(Markers { side_mm, board }) = &self.markers {
            let dictionary = board.spec().dictionary;
            let margin = (square - side_mm) / 2.0;
            let cell = side_mm / (dictionary.marker_size() + 2) as f64;
            for (id, place) in board.iter_marker_positions() {
                let [left, top] = [place.u, place.v].map(|index| f64::from(index) * square + margin);
                for (row, column, length) in runs(&dictionary, id) {
                    rectangles.push([left + column as f64 * cell, top + row as f64 * cell, length as f64 * cell, cell]);
                }
            }
        }
        rectangles
    }
}

/// The black cells of a marker with its border, in runs: row, first column and length, in cells.
fn runs(dictionary: &Dictionary, id: u32) -> Vec<(usize, usize, usize)> {
    let bits = dictionary.marker_size();
    let side = bits + 2;
    let code = dictionary.codes().get(id as usize).copied().unwrap_or_default();
    let inner = 1..=bits;
    let is_black = |row: usize, column: usize| {
        !(inner.contains(&row) && inner.contains(&column)) || code >> ((row - 1) * bits + column - 1) & 1 == 1
    };
    let mut runs: Vec<(usize, usize, usize)> = Vec::new();
    for row in 0..side {
        for column in (0..side).filter(|&column| is_black(row, column)) {
            match runs.last_mut() {
                Some((last, first, length)) if *last == row && *first + *length == column => *length += 1,
                _ => runs.push((row, column, 1)),
            }
        }
    }
    runs
}

/// As its caption: `ChArUco board of 10x7 squares of 25 mm, markers of 18.75 mm of DICT_4X4_250`.
impl fmt::Display for PrintedBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PrintedBoard { columns, rows, square_mm, markers } = self;
        match markers {
            None => write!(f, "chessboard of {columns}x{rows} squares of {square_mm} mm"),
            Some(Markers { side_mm, board }) => {
                let dictionary = board.spec().dictionary.name().to_owned();
                write!(f, "ChArUco board of {columns}x{rows} squares of {square_mm} mm, markers of {side_mm} mm of {dictionary}")
            }
        }
    }
}
