//! The files that commands write.

mod map_files;
pub mod output_file;

pub use map_files::MapFiles;
