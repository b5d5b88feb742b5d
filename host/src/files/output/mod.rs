//! Writing files and folders as a whole: an output is complete, or it is not there.

mod destination;
mod file;
mod leftovers;
mod temporary;

pub use destination::check;
pub use file::{check_folder, replace_together, write, write_folder, write_together};
pub use temporary::{abandon, broken_seal};
