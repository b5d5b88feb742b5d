//! How disparities are estimated.

use multiscopic_core::Params;

use crate::{
    error::Result,
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::{
        Engine,
        cost::mccnn::McCnn,
        optimization::{graph_cuts::GraphCuts, sgm::SemiGlobal},
        refinement::filter::Filters,
    },
};

/// A method and its parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Block matching by the core: the least sum of absolute differences.
    BlockMatching,
    /// Graph cuts, the minimum of an energy of the whole image, and filters after them.
    GraphCuts(GraphCuts, Filters),
    /// Semi-global matching on costs of the census transform, and filters after it.
    SemiGlobal(SemiGlobal, Filters),
    /// Costs by a network, summed along paths, and filters after that.
    McCnn(Box<McCnn>, Filters),
}

impl Method {
    /// Estimates the disparities of the centre of `frames` with the views of `params`.
    ///
    /// # Errors
    /// If the method cannot be applied to these frames.
    ///
    /// # Panics
    /// If `params` were made for frames of another size or with views that are not there.
    pub fn disparities(
        &self,
        engine: &Engine,
        frames: &Frames,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let (map, filters) = match self {
            Method::BlockMatching => {
                progress.begin(params.height() as u64, "lines");
                return Ok(engine.disparities(frames, params, || progress.advance(1)));
            }
            Method::GraphCuts(cuts, filters) => (cuts.disparities(engine, frames, params, progress)?, filters),
            Method::SemiGlobal(sgm, filters) => (sgm.disparities(engine, frames, params, progress), filters),
            Method::McCnn(mccnn, filters) => (mccnn.disparities(engine, frames, params, progress), filters),
        };
        Ok(engine.pool().install(|| filters.apply(map)))
    }
}
