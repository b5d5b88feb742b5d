//! The parameters by which the page computes costs.

use multiscopic_core::{Search, View};
use serde::Serialize;

/// The block matching whose costs the page computes at a pixel, from the pictures.
#[derive(Clone, Debug, Serialize)]
pub struct BlockCosts {
    block_size: u8,
    min_disparity: i16,
    num_disparities: usize,
    fusion: &'static str,
    /// Baselines to the right and down.
    views: Vec<[i8; 2]>,
    /// Whether these are the costs by which the map was made.
    exact: bool,
}

impl BlockCosts {
    /// The costs of a search with blocks. `exact` tells whether the map was made by them.
    pub fn new(search: &Search, block_size: u8, exact: bool) -> BlockCosts {
        BlockCosts {
            block_size,
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            fusion: search.fusion().name(),
            views: search.views().iter().map(|view: View| [view.right(), view.down()]).collect(),
            exact,
        }
    }

    /// Baselines to the right and down of the views whose costs these are.
    pub(super) fn views(&self) -> &[[i8; 2]] {
        &self.views
    }
}
