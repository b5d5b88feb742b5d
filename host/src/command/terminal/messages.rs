//! Results on standard output and messages on standard error.

use std::{
    fmt::Display,
    io::{self, ErrorKind, Write},
    sync::atomic::{AtomicBool, Ordering},
};

use multiscopic::{Error, Result, stereo::confidence_map::SURE};
use serde::Serialize;

use super::columns::{columns, wrapped};

/// Writes to standard output. It is not an error if the reader has closed it, as `| head` does.
pub fn print(text: &str) -> Result<()> {
    print_bytes(text.as_bytes())
}

/// Writes bytes to standard output. A closed pipe is no error.
pub fn print_bytes(bytes: &[u8]) -> Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(Error::Write { path: "standard output".into(), source }),
        _ => Ok(()),
    }
}

/// Writes a report to standard output: as one line of JSON, or as text that fits the terminal.
pub fn print_report(report: &(impl Display + Serialize), json: bool) -> Result<()> {
    let text = match json {
        true => serde_json::to_string(report).expect("a report is numbers and strings") + "\n",
        false => columns().map_or_else(|| report.to_string(), |limit| wrapped(&report.to_string(), limit)),
    };
    print(&text)
}

/// Whether notes are left out.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Leaves out notes and progress bars from now on.
pub fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// Whether notes and progress bars are left out.
pub fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Writes a note to standard error, unless notes are left out. Ignores failure.
pub fn say(note: &str) {
    if !is_quiet() {
        complain(note);
    }
}

/// Writes a warning to standard error, and ignores failure.
pub fn warn(message: &str) {
    complain(&format!("warning: {message}"));
}

/// Writes an error, or what leads to one, to standard error, and ignores failure.
pub fn complain(message: &str) {
    let _ = writeln!(io::stderr(), "multiscopic: {message}");
}

/// What a summary says about the share of confidences from [`SURE`] on, after what it says about disparities.
pub fn sure(share: f64) -> String {
    format!(", {:.1} % sure (from {SURE} on)", 100.0 * share)
}
