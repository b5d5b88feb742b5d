//! `multiscopic listen`: disparity maps from the firmware's packets.

use std::{
    fmt::{self, Display},
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
use serde::Serialize;

#[cfg(unix)]
use super::raw_port;
use super::{
    advice, limits,
    options::{MapFiles, output_file},
    terminal,
};

/// Receives a disparity map from the firmware, and reports the packets that are lost or damaged
///
/// Reads packets up to the end of the frame, or of the next if it begins in the middle of one. A serial port is set raw
/// meanwhile, and keeps its speed, which other programs set:
///
///     stty -F /dev/ttyACM0 115200
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
    #[arg(long, value_name = "OUT.png", help_heading = "Output", value_parser = output_file::png())]
    confidence: Option<PathBuf>,

    /// Print the summary as one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// The outcome of a reception. Shares are from 0 to 1.
#[derive(Debug, Serialize)]
struct Summary {
    width: usize,
    height: usize,
    /// The share of pixels that arrived.
    received: f64,
    /// The share of pixels with a disparity.
    valid: f64,
    /// The share with a confidence from 0.9 on, if confidences arrived.
    #[serde(skip_serializing_if = "Option::is_none")]
    sure: Option<f64>,
    /// Bytes of stack that the firmware took, if it told.
    #[serde(skip_serializing_if = "Option::is_none")]
    stack: Option<usize>,
    /// Packets or groups of packets that were lost, damaged or foreign.
    flaws: usize,
}

/// The number of flaws that are reported one by one. The others are counted.
const REPORTED_FLAWS: usize = 10;

/// The name of standard input on the command line.
const STANDARD_INPUT: &str = "-";

impl Listen {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let (path, source): (&Path, Box<dyn BufRead>) = if self.source == Path::new(STANDARD_INPUT) {
            #[cfg(unix)]
            raw_port::check_standard_input()?;
            (Path::new("standard input"), Box::new(io::stdin().lock()))
        } else {
            #[cfg(unix)]
            let file = raw_port::RawPort::open(&self.source)?;
            #[cfg(not(unix))]
            let file = std::fs::File::open(&self.source).map_err(|source| Error::Read { path: self.source.clone(), source })?;
            (&self.source, Box::new(BufReader::new(file)))
        };
        let outputs: Vec<&Path> = self.maps.paths().chain(self.confidence.as_deref()).collect();
        if !self.maps.check_printed(&[("--json", self.json)])? && outputs.is_empty() {
            let message = "there is nothing to write: give -o OUT.pfm, or another output such as --png OUT.png or --json";
            return Err(Error::Usage(message.into()));
        }
        output::check(&outputs, &[path])?;

        let bar = terminal::progress(0, "pixels");
        let (mut is_whole, mut flaws) = (true, 0);
        let received = reception::receive(source, path, limits(), |notice| match notice {
            Notice::Line { pixels, of } => {
                bar.set_length(of as u64);
                bar.set_position(pixels as u64);
            }
            Notice::Late => bar.suspend(|| {
                terminal::say(&format!("{}: it began in the middle of a frame, the next one is waited for", path.display()));
            }),
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
        advice::no_disparity(&received.disparities).into_iter().for_each(terminal::warn);
        let summary = Summary::new(&received, flaws);
        match self.json {
            true => terminal::print_report(&summary, true)?,
            false => terminal::say(&summary.to_string()),
        }
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

impl Summary {
    fn new(frame: &ReceivedFrame, flaws: usize) -> Summary {
        let ReceivedFrame { disparities, confidences, pixels, stack } = frame;
        let share = |count: usize| count as f64 / disparities.pixels().len() as f64;
        Summary {
            width: disparities.width(),
            height: disparities.height(),
            received: share(*pixels),
            valid: share(disparities.pixels().iter().flatten().count()),
            sure: confidences.as_ref().map(confidence_map::sure_share),
            stack: *stack,
            flaws,
        }
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Summary { width, height, received, valid, sure, stack, .. } = self;
        write!(f, "{width}x{height}: {:.1} % received, {:.1} % valid", 100.0 * received, 100.0 * valid)?;
        sure.map_or(Ok(()), |sure| f.write_str(&terminal::sure(sure)))?;
        stack.map_or(Ok(()), |bytes| write!(f, ", {bytes} bytes of stack"))
    }
}
