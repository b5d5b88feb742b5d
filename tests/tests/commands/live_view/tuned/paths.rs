use multiscopic::{DisparityMap, Engine, Frames, Method, Result, stereo, stereo::refinement};
use multiscopic_core::{Fusion, SearchConfig};

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let [width, height] = frames.size().map(|side| side as u16);
    let range = SearchConfig { min_disparity: 1, num_disparities: 40, ..SearchConfig::of_size(width, height) };
    let search = SearchConfig { views: frames.views(), fusion: Fusion::Heuristic, ..range }.checked()?;
    let penalties = multiscopic_core::PathPenalties::new(5, 30, Some(12))?;
    let paths = multiscopic::SemiGlobal { paths: stereo::Paths::Eight, penalties };
    let cost = stereo::CostFunction::TwoScaleCensus(multiscopic_core::Census::Window7x7);
    let pipeline = stereo::Pipeline::SemiGlobal { cost, paths };
    let mut method = Method::new(pipeline);
    method.refinement.smoother = Some(refinement::Smoother::DEFAULT);
    method.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
