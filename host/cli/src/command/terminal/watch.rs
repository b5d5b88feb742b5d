//! Progress of long work on the terminal.

use indicatif::ProgressBar;
use multiscopic::Progress;

use super::bar;

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
        Watch { bar: bar::progress(0, "") }
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
        self.bar.set_style(bar::style(name));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    fn say(&self, message: &str) {
        self.bar.set_message(message.to_owned());
    }
}
