//! Boards to print: PDF and PNG.

use std::{fmt::Write, io, path::Path};

use super::printed_board::PrintedBoard;
use crate::{
    error::{Error, Result},
    files::output,
    images::Raster,
};

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
