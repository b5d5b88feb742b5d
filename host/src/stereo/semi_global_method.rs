//! Semi-global matching as options describe it.

use multiscopic_core::{Census, PathPenalties};

use super::{
    Paths, SemiGlobal,
    cost_function::CostName,
    method::{Method, Pipeline},
};
use crate::error::Result;

/// Semi-global matching, with penalties that follow from the cost unless they are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SemiGlobalMethod {
    /// The matching cost.
    pub cost: CostName,
    /// The window of census transforms.
    pub census: Census,
    /// The side of the block of [`CostName::Sad`] in pixels: 5 if it is `None`.
    pub block_size: Option<u8>,
    /// The penalty for a disparity change of one.
    pub p1: Option<u8>,
    /// The penalty for larger changes: six times P1 if that alone is given.
    pub p2: Option<u8>,
    /// The difference of brightness above which P2 is lowered.
    pub p2_edge: Option<u8>,
    /// The sides that paths come from.
    pub paths: Paths,
}

impl Default for SemiGlobalMethod {
    /// The census transform in its usual window, and five paths.
    fn default() -> SemiGlobalMethod {
        let (cost, census, paths) = (CostName::Census, Census::Window9x7, Paths::default());
        SemiGlobalMethod { cost, census, block_size: None, p1: None, p2: None, p2_edge: None, paths }
    }
}

impl SemiGlobalMethod {
    /// The method, for matches in a number of `views` at the shortest baseline.
    ///
    /// # Errors
    /// If the block size or a penalty is out of range.
    pub fn method(&self, views: usize) -> Result<Method> {
        let cost = self.cost.function(self.census, self.block_size)?;
        let default = cost.default_penalties(views);
        let p1 = self.p1.unwrap_or(default.p1());
        let p2 = match self.p1 {
            Some(p1) => p1.saturating_mul(6).min(PathPenalties::MAX),
            None => default.p2(0),
        };
        let penalties = PathPenalties::new(p1, self.p2.unwrap_or(p2), self.p2_edge.or(default.p2_edge()))?;
        Ok(Method::new(Pipeline::SemiGlobal { cost, paths: SemiGlobal { paths: self.paths, penalties } }))
    }
}
