//! Standard output, standard error, and progress bars.

mod bar;
mod messages;
mod watch;

pub use bar::progress;
pub use messages::{print, print_report, say, sure};
pub use watch::Watch;
