//! The methods by name, each with its defaults, and semi-global matching as options describe it.

use multiscopic_core::{Census, Fusion, PathPenalties};

use super::{
    Paths, SemiGlobal,
    aggregation::{Aggregation, SupportRegion},
    cost::mccnn::{Architecture, Network},
    cost_function::CostName,
    method::{Method, Pipeline},
    optimization::edge_aware::Penalties,
    refinement::{LucasKanade, OcclusionFill, Refinement, SearchMargin},
};
use crate::error::Result;

/// A pipeline of steps that are known to work well together, by the name that the program has for it.
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

impl MethodName {
    /// All methods.
    pub const ALL: [MethodName; 6] =
        [MethodName::Bm, MethodName::Gc, MethodName::Sgm, MethodName::MccnnFast, MethodName::MccnnAccurate, MethodName::Net];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            MethodName::Bm => "bm",
            MethodName::Gc => "gc",
            MethodName::Sgm => "sgm",
            MethodName::MccnnFast => "mccnn-fast",
            MethodName::MccnnAccurate => "mccnn-accurate",
            MethodName::Net => "net",
        }
    }

    /// The fusion rule of so many views at the shortest baseline, for the method with its defaults.
    pub fn default_fusion(self, views: usize) -> Fusion {
        match self {
            MethodName::Sgm => SemiGlobalMethod::default().default_fusion(views),
            MethodName::Net => Fusion::default_for_census(views),
            _ => Fusion::default_for(views),
        }
    }

    /// The method with its defaults, for matches in a number of `views` at the shortest baseline. `block_size` is that of block
    /// matching: [`DEFAULT_BLOCK_SIZE`](Method::DEFAULT_BLOCK_SIZE) if it is `None`.
    ///
    /// # Errors
    /// If the weights of MC-CNN are not installed.
    pub fn method(self, block_size: Option<u8>, views: usize) -> Result<Method> {
        let refinement = Refinement { occlusions: (views == 1).then(OcclusionFill::default), ..Refinement::NONE };
        let method = match self {
            MethodName::Bm => Method::block_matching(block_size.unwrap_or(Method::DEFAULT_BLOCK_SIZE)),
            MethodName::Gc => Method::graph_cuts(),
            MethodName::Sgm => SemiGlobalMethod::default().method(views)?,
            MethodName::MccnnFast => return mc_cnn(Architecture::Fast, Penalties::FAST),
            MethodName::MccnnAccurate => return mc_cnn(Architecture::Accurate, Penalties::ACCURATE),
            MethodName::Net => {
                let net = Method::net();
                let (margin, repair) = (SearchMargin::NETWORK, Some(net.smoother()));
                let occlusions = refinement.occlusions.map(|_| OcclusionFill::NETWORK);
                let sub_pixel = Some(LucasKanade);
                return Ok(net.with_refinement(Refinement { margin, sub_pixel, repair, occlusions, ..refinement }));
            }
        };
        Ok(method.with_refinement(refinement))
    }
}

/// MC-CNN with the installed weights of a network, as published for Middlebury.
fn mc_cnn(architecture: Architecture, penalties: Penalties) -> Result<Method> {
    let network = Box::new(Network::load(architecture)?);
    let aggregation = Aggregation { region: SupportRegion::ACCURATE, iterations: architecture.iterations() };
    Ok(Method::new(Pipeline::McCnn { network, aggregation, penalties }))
}

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
    /// The fusion rule of so many views by default, which depends on the cost.
    pub fn default_fusion(&self, views: usize) -> Fusion {
        match self.cost {
            CostName::Sad => Fusion::default_for(views),
            CostName::Census | CostName::Census2 => Fusion::default_for_census(views),
        }
    }

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
