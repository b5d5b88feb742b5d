//! `multiscopic listen`: disparity maps from the firmware's packets.

use std::{
    fs::File,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Error, Picture, Result,
    files::output,
    stereo::confidence_map,
    target::reception::{self, Notice, ReceivedFrame},
};

use super::{
    options::{MapFiles, output_file},
    terminal,
};

/// Receives a disparity map from the firmware, and reports the packets that are lost or damaged
///
/// Reads packets up to the end of the frame. A serial port is read like a file; configure it first, for example with
///
///     stty -F /dev/ttyACM0 raw 115200
///
/// Exit codes: 0 if everything arrived; 1 if packets are lost or damaged (their pixels are invalid, the rest
/// is written); 2 if the input cannot be read or contains no packets, or none of the confidences that are asked for.
#[derive(Clone, Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct Listen {
    /// File, serial port or other device to read packets from; - is standard input
    #[arg(value_name = "FILE|DEVICE|-", default_value = STANDARD_INPUT)]
    source: PathBuf,

    #[command(flatten)]
    maps: MapFiles,

    /// Confidences as an 8-bit image: the probability that a disparity is at most one pixel off, times 255, 0 where invalid;
    /// needs firmware that sends them, such as that of the profile qvga-confidence
    #[arg(long, value_name = "OUT.png", help_heading = "Output", value_parser = output_file::png)]
    confidence: Option<PathBuf>,
}

/// How many flaws are reported one by one. The others are counted.
const REPORTED_FLAWS: usize = 10;

/// The name of standard input on the command line.
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
        let outputs: Vec<&Path> = self.maps.paths().chain(self.confidence.as_deref()).collect();
        if outputs.is_empty() && !self.maps.is_printed() {
            return Err(Error::Usage(
                "there is nothing to write: give -o OUT.pfm, or another output such as --png OUT.png".into(),
            ));
        }
        output::check(&outputs, &[path])?;

        let bar = terminal::progress(0, "pixels");
        let (mut is_whole, mut flaws) = (true, 0);
        let received = reception::receive(source, path, |notice| match notice {
            Notice::Line { pixels, of } => {
                bar.set_length(of as u64);
                bar.set_position(pixels as u64);
            }
            Notice::Flaw(flaw) => {
                is_whole &= !flaw.is_harmful();
                flaws += 1;
                if flaws <= REPORTED_FLAWS {
                    bar.suspend(|| terminal::complain(&format!("{}: {flaw}", path.display())));
                }
            }
        });
        bar.finish_and_clear();
        if flaws > REPORTED_FLAWS {
            let more = flaws - REPORTED_FLAWS;
            terminal::complain(&format!(
                "{}: {more} more packets or groups of packets are lost, damaged or foreign",
                path.display()
            ));
        }

        let received = received?;
        output::write_together(|| {
            self.maps.write(&received.disparities)?;
            if let (Some(file), Some(confidences)) = (&self.confidence, &received.confidences) {
                Picture::from(confidences).write_png(file)?;
            }
            Ok(())
        })?;
        self.maps.print(&received.disparities)?;
        terminal::say(&summary(&received));
        if let (Some(_), None) = (&self.confidence, &received.confidences) {
            return Err(Error::Format {
                path: path.into(),
                found: "packets of disparities alone".into(),
                expected: "packets with confidences for --confidence, as firmware of a profile such as qvga-confidence sends"
                    .into(),
            });
        }
        Ok(ExitCode::from(if is_whole && received.is_complete() { 0 } else { 1 }))
    }
}

/// One line about the received map.
fn summary(received: &ReceivedFrame) -> String {
    let ReceivedFrame { disparities, confidences, pixels, stack } = received;
    let share = |count: usize| 100.0 * count as f64 / disparities.pixels().len() as f64;
    let valid = disparities.pixels().iter().flatten().count();
    let sure = confidences.as_ref().map(confidence_map::sure_share).map(terminal::sure).unwrap_or_default();
    let stack = stack.map(|bytes| format!(", {bytes} bytes of stack")).unwrap_or_default();
    format!(
        "{}x{}: {:.1} % received, {:.1} % valid{sure}{stack}",
        disparities.width(),
        disparities.height(),
        share(*pixels),
        share(valid)
    )
}
