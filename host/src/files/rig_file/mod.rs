//! `rig.toml`, and lists of the folders that have one.

mod rig;
mod rig_list;

pub use rig::{AlignmentRecord, Provenance, Residual, Rig};
pub use rig_list::ListedRig;
