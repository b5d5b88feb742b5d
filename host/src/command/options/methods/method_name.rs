//! The methods that the command line offers.

use crate::command::options::named::Named;

/// A method that the command line offers: a pipeline of steps that are known to work well together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MethodName {
    /// Block matching.
    Bm,
    /// Graph cuts.
    Gc,
    /// Semi-global matching.
    Sgm,
    /// MC-CNN with the fast network.
    MccnnFast,
    /// MC-CNN with the accurate network.
    MccnnAccurate,
    /// The network that is part of the program.
    Net,
}

impl Named for MethodName {
    const ALL: &'static [MethodName] =
        &[MethodName::Bm, MethodName::Gc, MethodName::Sgm, MethodName::MccnnFast, MethodName::MccnnAccurate, MethodName::Net];

    fn name(&self) -> &'static str {
        match self {
            MethodName::Bm => "bm",
            MethodName::Gc => "gc",
            MethodName::Sgm => "sgm",
            MethodName::MccnnFast => "mccnn-fast",
            MethodName::MccnnAccurate => "mccnn-accurate",
            MethodName::Net => "net",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            MethodName::Bm => "Block matching: the least sum of absolute differences",
            MethodName::Gc => "Graph cuts: the least energy of matching costs and smoothness",
            MethodName::Sgm => "Semi-global matching: the least costs along paths, by the census or by blocks",
            MethodName::MccnnFast => {
                "The least costs along paths, with costs by the fast MC-CNN network; its weights: `multiscopic weights install`"
            }
            MethodName::MccnnAccurate => "The same with the accurate network, which takes a hundred times as long",
            MethodName::Net => {
                "A small network that is part of the program: decides between semi-global matching at two scales, and repairs both"
            }
        }
    }
}
