//! `multiscopic calibrate board`: a board to print.

use std::{path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{Error, Result, calibration::Paper};

use super::board_options::BoardOptions;
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
