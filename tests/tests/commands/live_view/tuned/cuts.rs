use multiscopic::{DisparityMap, Engine, Frames, Method, Result, stereo};
use multiscopic_core::{Fusion, SearchConfig};

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let [width, height] = frames.size().map(|side| side as u16);
    let range = SearchConfig { min_disparity: 1, num_disparities: 16, ..SearchConfig::of_size(width, height) };
    let search = SearchConfig { views: frames.views(), fusion: Fusion::Heuristic, ..range }.checked()?;
    let cost = stereo::cost::BirchfieldTomasi { color: true };
    let cuts = multiscopic::GraphCuts {
        occlusion: Some(12.0),
        lambda: [Some(4.0), None],
        smoothness: stereo::optimization::graph_cuts::Smoothness::Potts,
        start_block_size: 7,
        sweeps: 2,
        ..multiscopic::GraphCuts::default()
    };
    let pipeline = stereo::Pipeline::GraphCuts { cost, cuts };
    let method = Method::new(pipeline);
    method.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
