//! Printed boards, and the files to print them from: PDF and PNG.

use std::{
    fmt::{self, Write},
    io,
    path::Path,
};

use calib_targets_charuco::{CharucoBoard, CharucoBoardSpec, Dictionary, resolve_dictionary};

use crate::{
    error::{Error, Result},
    files::output,
    images::Raster,
};

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

/// A size of paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 297 x 420 mm.
    A3,
    /// 8.5 x 11 inches.
    Letter,
}

/// The margin that printers leave white at each side, in millimetres.
const MARGIN_MM: f64 = 6.0;
/// The height of the caption below the board, in millimetres.
const CAPTION_MM: f64 = 11.0;
/// The length of the line that tells whether the page was printed to scale, in millimetres.
const RULER_MM: f64 = 100.0;
/// The white border of a board in a PNG, in squares.
const BORDER: f64 = 0.5;
/// The most pixels of a PNG: those of A0 at 300 dots per inch.
const MOST_PIXELS: f64 = 150e6;

impl Paper {
    /// All sizes.
    pub const ALL: [Paper; 3] = [Paper::A4, Paper::A3, Paper::Letter];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Paper::A4 => "a4",
            Paper::A3 => "a3",
            Paper::Letter => "letter",
        }
    }

    /// The short and the long side in millimetres.
    pub fn size_mm(self) -> [f64; 2] {
        match self {
            Paper::A4 => [210.0, 297.0],
            Paper::A3 => [297.0, 420.0],
            Paper::Letter => [215.9, 279.4],
        }
    }
}

impl PrintedBoard {
    /// Writes a page with the board at its exact size, and a caption with a line of 100 mm below it. The longer side of the
    /// board lies along the longer side of the paper.
    ///
    /// # Errors
    /// [`Error::Usage`] if the board does not fit on the paper, and [`Error::Write`].
    pub fn write_pdf(&self, path: &Path, paper: Paper) -> Result<()> {
        let [width, height] = self.size_mm();
        let [short, long] = paper.size_mm();
        let page = if width > height { [long, short] } else { [short, long] };
        let room = [page[0] - 2.0 * MARGIN_MM, page[1] - 2.0 * MARGIN_MM - CAPTION_MM];
        if width > room[0] || height > room[1] {
            let [columns, rows] = self.squares().map(f64::from);
            let largest = (room[0] / columns).min(room[1] / rows).floor();
            let message = format!(
                "a board of {width}x{height} mm does not fit on {}: choose squares of at most {largest} mm, fewer of them, or a \
                 larger paper",
                paper.name()
            );
            return Err(Error::Usage(message));
        }
        let text = pdf(page, &self.drawing(page));
        output::write(path, |writer| writer.write_all(text.as_bytes()))
    }

    /// The operators that draw the board and its caption in the middle of a page.
    fn drawing(&self, page: [f64; 2]) -> String {
        let [width, height] = self.size_mm();
        let left = (page[0] - width) / 2.0;
        let top = (page[1] - height - CAPTION_MM) / 2.0;
        let mut operators = String::from("0 g\n");
        for [x, y, w, h] in self.black_rectangles() {
            // The origin of a page is at its bottom left.
            let bottom = page[1] - top - y - h;
            let _ = writeln!(operators, "{} {} {} {} re", points(left + x), points(bottom), points(w), points(h));
        }
        // One fill for all, so that no seams are left between rectangles.
        operators += "f\n";
        let (ruler, text) = (page[1] - top - height - 5.0, page[1] - top - height - 9.0);
        let (start, end) = (points(left), points(left + RULER_MM));
        let _ = writeln!(operators, "0.3 w {start} {y} m {end} {y} l S", y = points(ruler));
        for x in [start, end] {
            let _ = writeln!(operators, "{x} {} m {x} {} l S", points(ruler - 1.0), points(ruler + 1.0));
        }
        let caption = format!("{self}. Print at 100 %, not fitted to the page: the line above is then {RULER_MM} mm long.");
        let caption = caption.replace(['(', ')', '\\'], " ");
        let _ = writeln!(operators, "BT /F1 7 Tf {} {} Td ({caption}) Tj ET", points(left), points(text));
        operators
    }

    /// Writes a PNG of the board with a white border of half a square, which records its resolution in dots per inch.
    ///
    /// # Errors
    /// [`Error::Usage`] if the picture would be absurdly large, or a square smaller than 16 pixels, and [`Error::Write`].
    pub fn write_png(&self, path: &Path, dpi: f64) -> Result<()> {
        const SMALLEST_SQUARE: f64 = 16.0;
        let per_mm = dpi / 25.4;
        let square = self.square_mm() * per_mm;
        let [width, height] = self.size_mm().map(|side| ((side + 2.0 * self.border_mm()) * per_mm).round());
        if width * height > MOST_PIXELS || square < SMALLEST_SQUARE {
            let message = format!(
                "{dpi} dots per inch give {width}x{height} pixels and {square:.0} for a square: choose a resolution that gives at \
                 least {SMALLEST_SQUARE} for a square and at most {:.0} million in all",
                MOST_PIXELS / 1e6
            );
            return Err(Error::Usage(message));
        }
        let raster = self.raster(per_mm);
        output::write(path, |writer| {
            let mut encoder = png::Encoder::new(writer, width as u32, height as u32);
            encoder.set_color(png::ColorType::Grayscale);
            encoder.set_depth(png::BitDepth::Eight);
            let per_metre = (1000.0 * per_mm).round() as u32;
            let unit = png::Unit::Meter;
            encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit }));
            let mut writer = encoder.write_header().map_err(io::Error::other)?;
            writer.write_image_data(raster.pixels()).map_err(io::Error::other)?;
            writer.finish().map_err(io::Error::other)
        })
    }

    /// The width of the white border of [`raster`](PrintedBoard::raster) in millimetres.
    pub fn border_mm(&self) -> f64 {
        BORDER * self.square_mm()
    }

    /// The board with a white border in grey values, with `per_mm` pixels for a millimetre. Pixels across an edge are grey by
    /// the share that is black.
    pub fn raster(&self, per_mm: f64) -> Raster<u8> {
        let border = self.border_mm();
        let [width, height] = self.size_mm().map(|side| ((side + 2.0 * border) * per_mm).round() as usize);
        let mut black = Raster::new(width, height, vec![0.0_f64; width * height]);
        for [x, y, w, h] in self.black_rectangles() {
            let [left, right] = [x, x + w].map(|at| (at + border) * per_mm);
            let [top, bottom] = [y, y + h].map(|at| (at + border) * per_mm);
            for v in top as usize..(bottom.ceil() as usize).min(height) {
                let of_row = bottom.min(v as f64 + 1.0) - top.max(v as f64);
                for u in left as usize..(right.ceil() as usize).min(width) {
                    let of_column = right.min(u as f64 + 1.0) - left.max(u as f64);
                    black.pixels_mut()[v * width + u] += of_row * of_column;
                }
            }
        }
        let gray = black.pixels().iter().map(|share| (255.0 * (1.0 - share)).round() as u8).collect();
        Raster::new(width, height, gray)
    }
}

/// Millimetres in the unit of PDF.
fn points(mm: f64) -> String {
    format!("{:.4}", mm * 72.0 / 25.4)
}

/// A document of one page, `page` millimetres large, with the contents `operators`.
fn pdf(page: [f64; 2], operators: &str) -> String {
    let [width, height] = page.map(points);
    let objects = [
        // Viewers that obey this do not offer to fit the page to the paper.
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] /Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>"
        ),
        format!("<< /Length {} >>\nstream\n{operators}endstream", operators.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
    ];
    let mut document = String::from("%PDF-1.6\n");
    let mut offsets = Vec::new();
    for (index, object) in objects.iter().enumerate() {
        offsets.push(document.len());
        let _ = writeln!(document, "{} 0 obj\n{object}\nendobj", index + 1);
    }
    let start = document.len();
    let _ = writeln!(document, "xref\n0 {}\n0000000000 65535 f ", objects.len() + 1);
    for offset in offsets {
        let _ = writeln!(document, "{offset:010} 00000 n ");
    }
    let _ = writeln!(document, "trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF", objects.len() + 1);
    document
}
