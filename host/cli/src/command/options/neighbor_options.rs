//! The options of which neighbours are captured.

use clap::Args;
use multiscopic::{Result, images::Layout};
use multiscopic_core::Views;

use super::views_of_count;

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
