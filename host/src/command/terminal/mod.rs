//! Standard output, standard error, progress bars, pictures, examples in the help, and signals.

mod bar;
mod browser;
pub mod examples;
mod messages;
mod preview;
pub mod signals;
mod watch;

pub use bar::progress;
pub use browser::open;
pub use messages::{print, print_bytes, print_report, say, sure};
pub use preview::preview;
pub use watch::Watch;
