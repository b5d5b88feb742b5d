//! Progress of long work on the terminal.

use indicatif::{ProgressBar, ProgressStyle};
use multiscopic::Progress;

use super::messages;

/// A progress bar.
///
/// It does not pass on that the user presses Ctrl-C: a method would end early with what it has so far, which is not what was
/// asked for.
#[derive(Debug)]
pub struct Watch {
    bar: ProgressBar,
}

impl Watch {
    /// A bar without a stage yet.
    pub fn new() -> Watch {
        Watch { bar: progress(0, "") }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Watch {
    fn begin(&self, steps: u64, name: &str) {
        self.bar.reset();
        self.bar.set_length(steps);
        self.bar.set_style(style(name));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    fn say(&self, message: &str) {
        self.bar.set_message(message.to_owned());
    }
}

/// A progress bar on standard error for `length` `steps` (a plural noun). It is hidden unless standard error is a terminal,
/// and if notes are left out.
pub fn progress(length: u64, steps: &str) -> ProgressBar {
    let bar = if messages::is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(length) };
    bar.with_style(style(steps))
}

/// The style of a bar that counts `steps`.
pub fn style(steps: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {steps}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is valid")
}
