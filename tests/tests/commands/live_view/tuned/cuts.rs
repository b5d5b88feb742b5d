use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "gc", "--num-disparities", "16", "--block-size", "7", "--occlusion-cost", "12", "--lambda1", "4", "--smoothness", "potts", "--sweeps", "2"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
