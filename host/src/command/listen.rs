//! `multiscopic listen`: from the packets of firmware to pictures.

use std::{
    fs::File,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Error, Result,
    files::output,
    target::reception::{self, Notice, ReceivedFrame},
};

use super::{options::MapFiles, terminal};

/// Receives a frame of disparities from firmware, and names every packet that is lost or damaged
///
/// Reads packets until the one that ends the frame. A serial port is read as a file; set it up first, for example with
///
///     stty -F /dev/ttyACM0 raw 115200
///
/// Exit codes: 0 if all came, 1 if something is lost or damaged (what came is written, the rest is invalid), 2 if the input brings no
/// packets or cannot be read.
#[derive(Clone, Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct Listen {
    /// File, serial port or other device with the packets, - for standard input
    #[arg(value_name = "FILE|DEVICE|-", default_value = STANDARD_INPUT)]
    source: PathBuf,

    #[command(flatten)]
    maps: MapFiles,
}

/// How the command line names standard input.
const STANDARD_INPUT: &str = "-";

impl Listen {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let (path, source): (&Path, Box<dyn BufRead>) = if self.source == Path::new(STANDARD_INPUT) {
            (Path::new("standard input"), Box::new(io::stdin().lock()))
        } else {
            let file = File::open(&self.source).map_err(|source| Error::Read { path: self.source.clone(), source })?;
            (&self.source, Box::new(BufReader::new(file)))
        };
        output::check(&self.maps.paths().collect::<Vec<_>>(), &[path])?;

        let bar = terminal::progress(0, "pixels");
        let mut is_whole = true;
        let received = reception::receive(source, path, |notice| match notice {
            Notice::Line { pixels, of } => {
                bar.set_length(of as u64);
                bar.set_position(pixels as u64);
            }
            Notice::Flaw(flaw) => {
                is_whole &= !flaw.is_harmful();
                bar.suspend(|| terminal::say(&format!("{}: {flaw}", path.display())));
            }
        });
        bar.finish_and_clear();

        let received = received?;
        self.maps.write(&received.disparities)?;
        terminal::say(&summary(&received));
        Ok(ExitCode::from(if is_whole && received.is_complete() { 0 } else { 1 }))
    }
}

/// What came, in a line.
fn summary(received: &ReceivedFrame) -> String {
    let ReceivedFrame { disparities, pixels, stack } = received;
    let share = |count: usize| 100.0 * count as f64 / disparities.pixels().len() as f64;
    let valid = disparities.pixels().iter().flatten().count();
    let stack = stack.map(|bytes| format!(", {bytes} bytes of stack")).unwrap_or_default();
    format!("{}x{}: {:.1} % came, {:.1} % valid{stack}", disparities.width(), disparities.height(), share(*pixels), share(valid))
}
