//! Standard output, standard error, the terminal's width, progress bars, pictures, examples in the help, and signals.

pub mod examples;
mod messages;
mod preview;
mod progress;
pub mod signals;

pub use messages::{be_quiet, columns, complain, open, print, print_bytes, print_report, say, sure, visible, warn};
pub use preview::preview;
pub use progress::{Watch, progress};
