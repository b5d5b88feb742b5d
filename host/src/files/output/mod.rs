//! Writing files and folders as a whole: an output is complete, or it is not there.

mod check;
mod destination;
mod file;
mod folder;
mod leftovers;
mod temporary;

pub use check::check;
pub use file::{replace_together, write, write_together};
pub use folder::{check_folder, write_folder};
pub use temporary::{abandon, broken_seal};
