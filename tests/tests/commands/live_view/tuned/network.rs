use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "net", "--num-disparities", "40", "--fill", "background"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
