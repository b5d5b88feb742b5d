//! Standard output, standard error, progress bars, pictures, and signals.

mod bar;
mod messages;
mod preview;
pub mod signals;
mod watch;

pub use bar::progress;
pub use messages::{print, print_report, say, sure};
pub use preview::preview;
pub use watch::Watch;
