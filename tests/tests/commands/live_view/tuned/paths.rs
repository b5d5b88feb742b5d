use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "sgm", "--num-disparities", "40", "--cost", "census2", "--census", "7x7", "--p1", "5", "--p2", "30", "--p2-edge", "12", "--paths", "8", "--smooth"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
