//! Work on many items, which several machines may share, and the records of what is done.

mod batch_options;
mod fingerprint;
mod item_record;
mod run_file;
mod run_settings;
mod shard;

pub use batch_options::{BatchOptions, Done, names};
pub use fingerprint::Fingerprint;
pub use item_record::{ItemRecord, OutputRecord};
pub use run_file::RunFile;
pub use run_settings::RunSettings;
