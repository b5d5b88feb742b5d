//! Options that several commands share. Those of matching are in a crate of their own, which Python has, too.

mod geometry_options;
mod hardware_options;
mod neighbor_options;
mod outputs;
mod source_options;

pub use multiscopic_options::{
    BaselineOptions, BitsOption, EngineOptions, MatchingOptions, MemoryOptions, MethodOptions, Named, PRIOR_EXCLUDES,
    PreparationOptions, SearchOptions, named, value, views_of_count,
};

pub use geometry_options::GeometryOptions;
#[cfg(feature = "calibration")]
pub use hardware_options::SettingsOptions;
pub use hardware_options::{CameraSpec, HardwareOptions, micrometres};
pub use neighbor_options::NeighborOptions;
pub use outputs::{MapFiles, output_file};
pub use source_options::{Source, SourceOptions, depth_of};
