//! Progress of long work on the terminal, and Ctrl-C.

use std::{
    process,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use indicatif::ProgressBar;
use multiscopic::{Error, Progress, Result};

use super::bar;

/// A progress bar and a handler for Ctrl-C.
///
/// Work that polls [`is_interrupted`](Progress::is_interrupted) ends early with the result it has so far. A second
/// Ctrl-C ends the program; so does the first if the work does not poll.
#[derive(Debug)]
pub struct Watch {
    bar: ProgressBar,
    interrupts: Arc<Interrupts>,
}

#[derive(Debug, Default)]
struct Interrupts {
    polled: AtomicBool,
    received: AtomicBool,
}

impl Watch {
    /// Installs the handler. A program can do so once.
    ///
    /// # Errors
    /// A handler is installed already.
    pub fn new() -> Result<Watch> {
        let interrupts = Arc::new(Interrupts::default());
        let handled = interrupts.clone();
        ctrlc::set_handler(move || {
            let Interrupts { polled, received } = &*handled;
            if received.swap(true, Ordering::Relaxed) || !polled.load(Ordering::Relaxed) {
                // The shell's convention: 128 plus the signal number.
                process::exit(130);
            }
        })
        .map_err(|error| Error::Usage(format!("cannot handle Ctrl-C: {error}")))?;
        let bar = bar::progress(0, "");
        Ok(Watch { bar, interrupts })
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

    fn is_interrupted(&self) -> bool {
        self.interrupts.polled.store(true, Ordering::Relaxed);
        self.interrupts.received.load(Ordering::Relaxed)
    }
}
