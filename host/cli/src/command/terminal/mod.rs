//! Standard output, standard error, the terminal's width, progress bars, pictures, examples in the help, and signals.

mod bar;
mod browser;
mod columns;
pub mod examples;
mod messages;
mod preview;
pub mod signals;
mod watch;

pub use bar::progress;
pub use browser::open;
pub use columns::columns;
pub use messages::{be_quiet, complain, print, print_bytes, print_report, say, sure, visible, warn};
pub use preview::preview;
pub use watch::Watch;
