//! Options that several commands share.

mod baseline_options;
mod bits_option;
mod engine_options;
mod geometry_options;
mod hardware_options;
mod memory_options;
mod methods;
mod named;
mod neighbor_options;
mod outputs;
mod search_options;
mod source_options;
pub mod value;

pub use baseline_options::BaselineOptions;
pub use bits_option::BitsOption;
pub use engine_options::EngineOptions;
pub use geometry_options::GeometryOptions;
#[cfg(feature = "calibration")]
pub use hardware_options::SettingsOptions;
pub use hardware_options::{CameraSpec, HardwareOptions, micrometres};
pub use memory_options::{MemoryOptions, say_if_much};
pub use methods::{MatchingOptions, MethodOptions};
pub use named::{Named, named};
pub use neighbor_options::NeighborOptions;
pub use outputs::{MapFiles, output_file};
pub use search_options::{SearchOptions, views_of_count};
pub use source_options::{Source, SourceOptions};
