//! `rig.toml`.

mod alignment_record;
mod provenance;
mod residual;
mod rig;

pub use alignment_record::AlignmentRecord;
pub use provenance::Provenance;
pub use residual::Residual;
pub use rig::Rig;
