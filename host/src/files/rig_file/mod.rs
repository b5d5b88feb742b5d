//! `rig.toml`, and lists of the folders that have one.

mod alignment_record;
mod provenance;
mod residual;
mod rig;
mod rig_list;

pub use alignment_record::AlignmentRecord;
pub use provenance::Provenance;
pub use residual::Residual;
pub use rig::Rig;
pub use rig_list::ListedRig;
