//! Standard output, standard error, and progress bars.

mod watch;

use std::{
    fmt::Display,
    io::{self, ErrorKind, Write},
};

use indicatif::{ProgressBar, ProgressStyle};
use multiscopic::{Error, Result};
use serde::Serialize;
pub use watch::Watch;

/// Writes to standard output. It is not an error if the reader has closed it, as `| head` does.
pub fn print(text: &str) -> Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(Error::Write { path: "standard output".into(), source }),
        _ => Ok(()),
    }
}

/// Writes a report to standard output: as one line of JSON, or as text.
pub fn print_report(report: &(impl Display + Serialize), json: bool) -> Result<()> {
    let text = match json {
        true => serde_json::to_string(report).expect("a report is numbers and strings") + "\n",
        false => report.to_string(),
    };
    print(&text)
}

/// Writes a message to standard error, and ignores failure.
pub fn say(message: &str) {
    let _ = writeln!(io::stderr(), "multiscopic: {message}");
}

/// A progress bar on standard error for `length` `steps` (a plural noun). It is hidden unless standard error is a terminal.
pub fn progress(length: u64, steps: &str) -> ProgressBar {
    ProgressBar::new(length).with_style(style(steps))
}

/// The style of a bar that counts `steps`.
pub fn style(steps: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {steps}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is valid")
}
