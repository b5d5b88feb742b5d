//! A person who watches work at the terminal, and may have had enough.

use std::{
    process,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use indicatif::ProgressBar;
use multiscopic::{Error, Progress, Result};

/// A bar on standard error, and Ctrl-C: it ends work that asks for interrupts with what that has so far. The second Ctrl-C ends the
/// program, as does the first where nobody asks.
#[derive(Debug)]
pub struct Watch {
    bar: ProgressBar,
    interrupts: Arc<Interrupts>,
}

#[derive(Debug, Default)]
struct Interrupts {
    asked_for: AtomicBool,
    came: AtomicBool,
}

impl Watch {
    /// Watches from now on; there is one in a program.
    ///
    /// # Errors
    /// If Ctrl-C is watched already.
    pub fn new() -> Result<Watch> {
        let interrupts = Arc::new(Interrupts::default());
        let watched = interrupts.clone();
        ctrlc::set_handler(move || {
            let Interrupts { asked_for, came } = &*watched;
            if came.swap(true, Ordering::Relaxed) || !asked_for.load(Ordering::Relaxed) {
                // As the shell does it: 128 and the number of the signal.
                process::exit(130);
            }
        })
        .map_err(|error| Error::Usage(format!("Ctrl-C cannot be watched: {error}")))?;
        let bar = super::progress(0, "");
        Ok(Watch { bar, interrupts })
    }

    /// The work is done: the bar goes away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Watch {
    fn begin(&self, steps: u64, name: &str) {
        self.bar.reset();
        self.bar.set_length(steps);
        self.bar.set_style(super::style(name));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    fn say(&self, message: &str) {
        self.bar.set_message(message.to_owned());
    }

    fn is_interrupted(&self) -> bool {
        self.interrupts.asked_for.store(true, Ordering::Relaxed);
        self.interrupts.came.load(Ordering::Relaxed)
    }
}
