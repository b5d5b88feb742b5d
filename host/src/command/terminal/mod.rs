//! Standard output, standard error, progress bars, and signals.

mod bar;
mod messages;
pub mod signals;
mod watch;

pub use bar::progress;
pub use messages::{print, print_report, say, sure};
pub use watch::Watch;
