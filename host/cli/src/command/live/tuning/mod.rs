//! A rig that is matched while the options of `match` are set.

mod tuned_rig;
mod workbench;

pub use tuned_rig::TunedRig;
pub use workbench::{Wish, Workbench};
