//! What a person at the terminal sees.

mod watch;

use std::io::{self, ErrorKind, Write};

use indicatif::{ProgressBar, ProgressStyle};
use multiscopic::{Error, Result};
pub use watch::Watch;

/// Writes to standard output. A reader that has had enough (`| head`) is no error.
pub fn print(text: &str) -> Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(Error::Write { path: "standard output".into(), source }),
        _ => Ok(()),
    }
}

/// Writes a message to standard error, which may be closed.
pub fn say(message: &str) {
    let _ = writeln!(io::stderr(), "multiscopic: {message}");
}

/// A bar on standard error for work of `length` steps, each a `step`; nothing is shown where that is no terminal.
pub fn progress(length: u64, step: &str) -> ProgressBar {
    ProgressBar::new(length).with_style(style(step))
}

/// How a bar looks whose steps are each a `step`.
pub fn style(step: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {step}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is one")
}
