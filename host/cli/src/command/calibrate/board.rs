//! The printed board: its kinds, and `multiscopic calibrate board`, which writes one.

use std::{path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Error, Result,
    calibration::{Paper, PrintedBoard},
};

use crate::command::{
    options::{Named, named, value::positive},
    terminal,
};

/// Writes a board to print, for `multiscopic calibrate lens`
///
/// A PDF has the board at its exact size, with a line of 100 mm below it to check the printer. A PNG records its resolution. Glue
/// the print to something flat, such as glass or foam board.
#[derive(Clone, Debug, Args)]
pub struct Board {
    /// File to write; its name ends in .pdf or .png
    #[arg(short, long, value_name = "FILE.pdf|FILE.png")]
    output: PathBuf,

    /// Paper of a PDF
    #[arg(long, value_parser = named::<PaperName>(), default_value = "a4")]
    paper: PaperName,

    /// Resolution of a PNG in dots per inch
    #[arg(long, value_name = "N", value_parser = positive, default_value = "300", allow_negative_numbers = true)]
    dpi: f64,

    #[command(flatten)]
    board: BoardOptions,
}

impl Board {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let board = self.board.board()?;
        let extension = self.output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("pdf") => board.write_pdf(&self.output, self.paper.0)?,
            Some("png") => board.write_png(&self.output, self.dpi)?,
            _ => return Err(Error::Usage(format!("{}: its name must end in .pdf or .png", self.output.display()))),
        }
        terminal::say(&format!("wrote {}: {board}", self.output.display()));
        Ok(ExitCode::SUCCESS)
    }
}

/// The paper of a PDF, as options name it.
#[derive(Clone, Copy, Debug)]
struct PaperName(Paper);

impl Named for PaperName {
    const ALL: &'static [PaperName] = &[PaperName(Paper::A4), PaperName(Paper::A3), PaperName(Paper::Letter)];

    fn name(&self) -> &'static str {
        Paper::name(self.0)
    }

    fn about(&self) -> &'static str {
        match self.0 {
            Paper::A4 => "210 x 297 mm",
            Paper::A3 => "297 x 420 mm",
            Paper::Letter => "8.5 x 11 inches",
        }
    }
}

/// The share of a square that its marker has by default.
const MARKER_SHARE: f64 = 0.75;

/// The kind of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BoardKind {
    Charuco,
    Chessboard,
}

/// The board that is photographed.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Board")]
pub struct BoardOptions {
    /// Kind of the board
    #[arg(long, value_parser = named::<BoardKind>(), default_value = "charuco")]
    board: BoardKind,

    /// Squares in a row and in a column. OpenCV's sizes of chessboards count inner corners: one less on each side
    #[arg(long, value_name = "CxR", value_parser = squares, default_value = "10x7")]
    squares: [u32; 2],

    /// Side of a square in millimetres. It changes the distances that are reported, but not the lens
    #[arg(long, value_name = "MM", value_parser = positive, default_value = "25", allow_negative_numbers = true)]
    square: f64,

    /// Side of a ChArUco board's markers in millimetres [default: 3/4 of a square]
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    marker: Option<f64>,

    /// OpenCV's name for a ChArUco board's markers, such as 5X5_100 or APRILTAG_36h11
    #[arg(long, value_name = "NAME", default_value = "4X4_250")]
    dictionary: String,
}

impl BoardOptions {
    /// The board.
    pub fn board(&self) -> Result<PrintedBoard> {
        let [columns, rows] = self.squares;
        match self.board {
            BoardKind::Chessboard => PrintedBoard::chessboard(columns, rows, self.square),
            BoardKind::Charuco => {
                let marker = self.marker.unwrap_or(MARKER_SHARE * self.square);
                PrintedBoard::charuco(columns, rows, self.square, marker, &self.dictionary)
            }
        }
    }
}

impl Named for BoardKind {
    const ALL: &'static [BoardKind] = &[BoardKind::Charuco, BoardKind::Chessboard];

    fn name(&self) -> &'static str {
        match self {
            BoardKind::Charuco => "charuco",
            BoardKind::Chessboard => "chessboard",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            BoardKind::Charuco => "A chessboard with a marker in each white square: it may be partly out of view",
            BoardKind::Chessboard => "A chessboard without markers",
        }
    }
}

fn squares(text: &str) -> Result<[u32; 2]> {
    let sides = text.split_once('x').and_then(|(columns, rows)| Some([columns.parse().ok()?, rows.parse().ok()?]));
    sides.ok_or_else(|| Error::Usage("it must be columns and rows of squares, as 10x7".into()))
}
