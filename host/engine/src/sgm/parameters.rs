//! The paths of semi-global matching, and the penalties along them.

use multiscopic_core::{PathPenalties, SemiGlobalCost};

/// The sides that paths come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// Left, right, top and bottom, in two passes.
    Four,
    /// Left, right, and from the top straight and along both diagonals, in one pass. These are the core's.
    #[default]
    Five,
    /// All eight sides, in two passes.
    Eight,
}

impl Paths {
    /// All sets of paths.
    pub const ALL: [Paths; 3] = [Paths::Four, Paths::Five, Paths::Eight];

    /// The number of paths.
    pub const fn count(self) -> usize {
        match self {
            Paths::Four => 4,
            Paths::Five => 5,
            Paths::Eight => 8,
        }
    }
}

/// Semi-global matching: its paths and their penalties. Every value of this type is valid.
///
/// Start from [`default_for`](SemiGlobal::default_for) with the cost and the number of views. Then call
/// [`optimize`](SemiGlobal::optimize) with fused [costs](crate::cost::CostRows) to select disparities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SemiGlobal {
    /// The sides that paths come from.
    pub paths: Paths,
    /// The penalties for changes of disparity along the paths, in units of the matching cost, whatever the fusion.
    pub penalties: PathPenalties,
}

impl SemiGlobal {
    /// Five paths, and the penalties that suit a cost, fused over a number of views.
    pub fn default_for(cost: SemiGlobalCost, views: usize) -> SemiGlobal {
        SemiGlobal { paths: Paths::default(), penalties: cost.default_penalties(views) }
    }
}
