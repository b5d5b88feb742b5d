//! Options that several commands share.

mod engine;
mod geometry;
mod map_files;
mod method;
mod named;
mod search;
mod source;
pub mod value;

pub use engine::EngineOptions;
pub use geometry::GeometryOptions;
pub use map_files::MapFiles;
pub use method::{MethodName, MethodOptions};
pub use named::{Named, named};
pub use search::{SearchOptions, views_of_count};
pub use source::SourceOptions;
