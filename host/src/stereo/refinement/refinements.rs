//! Which refinements are applied, and in what order.

use multiscopic_core::Search;

use super::{bilateral::Bilateral, median::Median};
use crate::{
    images::DisparityMap,
    stereo::cost::{Cost, Volume},
};

/// The refinements that are applied, in the order of the fields; by default none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Refinement {
    /// The tolerance of the [left-right check](Volume::check_left_right) in pixels.
    pub left_right: Option<u16>,
    /// A median filter.
    pub median: Option<Median>,
    /// A bilateral filter.
    pub bilateral: Option<Bilateral>,
}

impl Refinement {
    /// No refinement.
    pub const NONE: Refinement = Refinement { left_right: None, median: None, bilateral: None };

    /// Whether [`check`](Refinement::check) needs the costs that the disparities were selected by.
    pub fn needs_costs(&self) -> bool {
        self.left_right.is_some()
    }

    /// Applies the left-right check, if there is one.
    pub fn check<C: Cost>(&self, search: &Search, costs: &Volume<C>, map: &mut DisparityMap) {
        if let Some(tolerance) = self.left_right {
            costs.check_left_right(search, map, tolerance);
        }
    }

    /// Applies the filters, on the threads of the current pool.
    pub fn filter(&self, mut map: DisparityMap) -> DisparityMap {
        if let Some(median) = self.median {
            map = median.apply(&map);
        }
        if let Some(bilateral) = self.bilateral {
            map = bilateral.apply(&map);
        }
        map
    }
}
