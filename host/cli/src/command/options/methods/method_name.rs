//! What `--help` says about the methods.

use multiscopic::stereo::MethodName;

use crate::command::options::named::Named;

impl Named for MethodName {
    const ALL: &'static [MethodName] = &MethodName::ALL;

    fn name(&self) -> &'static str {
        MethodName::name(*self)
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
