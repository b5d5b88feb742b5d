//! Options that several commands share. Those of matching are in a crate of their own, which Python has, too.

mod hardware_options;
pub mod output_file;
mod source_options;

use clap::Args;
use multiscopic::{Result, images::Layout};
use multiscopic_core::Views;

pub use hardware_options::{CameraSpec, HardwareOptions, RealCamera, SettingsOptions};
pub use multiscopic_options::{
    BaselineOptions, BitsOption, EngineOptions, MatchingOptions, MemoryOptions, MethodOptions, Named, PRIOR_EXCLUDES,
    PreparationOptions, SearchOptions, named, value, views_of_count,
};
pub use output_file::MapFiles;
pub use source_options::{GeometryOptions, LoadedSweep, Source, SourceOptions, depth_of, read_lens};

/// The neighbours that are captured.
#[derive(Clone, Copy, Debug, Args)]
pub struct NeighborOptions {
    /// Neighbours: right (1), left and right (2), top as well (3), all in the row and column (4), or all of a 3x3 array (8)
    #[arg(long, value_name = "1|2|3|4|8", default_value_t = 4)]
    views: usize,

    /// Neighbours on a cross or an array of rows and columns, instead of --views
    #[arg(long, value_name = "cross|3x3|RxC", conflicts_with = "views")]
    layout: Option<Layout>,
}

impl NeighborOptions {
    /// The neighbours.
    pub fn views(&self) -> Result<Views> {
        self.layout.map_or_else(|| views_of_count(self.views), |layout| Ok(layout.views()))
    }
}
