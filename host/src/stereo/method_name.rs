//! The methods by name, each with its defaults.

use super::{
    aggregation::{Aggregation, SupportRegion},
    cost::{
        BirchfieldTomasi,
        mccnn::{Architecture, Network},
    },
    method::{Method, Pipeline},
    optimization::{edge_aware::Penalties, graph_cuts::GraphCuts},
    refinement::{LucasKanade, Refinement},
    semi_global_method::SemiGlobalMethod,
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

    /// The method with its defaults, for matches in a number of `views` at the shortest baseline. `block_size` is that of block
    /// matching, with which graph cuts start: [`DEFAULT_BLOCK_SIZE`](Method::DEFAULT_BLOCK_SIZE) if it is `None`.
    ///
    /// # Errors
    /// If the weights of MC-CNN are not installed.
    pub fn method(self, block_size: Option<u8>, views: usize) -> Result<Method> {
        let block_size = block_size.unwrap_or(Method::DEFAULT_BLOCK_SIZE);
        Ok(match self {
            MethodName::Bm => Method::block_matching(block_size),
            MethodName::Gc => {
                let cuts = GraphCuts { start_block_size: block_size, ..GraphCuts::default() };
                Method::new(Pipeline::GraphCuts { cost: BirchfieldTomasi { color: true }, cuts })
            }
            MethodName::Sgm => SemiGlobalMethod::default().method(views)?,
            MethodName::MccnnFast => mc_cnn(Architecture::Fast, Penalties::FAST)?,
            MethodName::MccnnAccurate => mc_cnn(Architecture::Accurate, Penalties::ACCURATE)?,
            MethodName::Net => {
                let net = Method::net();
                let repair = Some(net.smoother());
                net.with_refinement(Refinement { sub_pixel: Some(LucasKanade), repair, ..Refinement::NONE })
            }
        })
    }
}

/// MC-CNN with the installed weights of a network, as published for Middlebury.
fn mc_cnn(architecture: Architecture, penalties: Penalties) -> Result<Method> {
    let network = Box::new(Network::load(architecture)?);
    let aggregation = Aggregation { region: SupportRegion::ACCURATE, iterations: architecture.iterations() };
    Ok(Method::new(Pipeline::McCnn { network, aggregation, penalties }))
}
