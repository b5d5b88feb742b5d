use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "bm", "--fusion", "mean", "--min-disparity", "-2", "--num-disparities", "40", "--block-size", "9", "--uniqueness-ratio", "5", "--disp12-max-diff", "2", "--texture-threshold", "100", "--median", "5", "--speckle-window-size", "30", "--speckle-range", "2", "--sub-pixel", "lucas-kanade", "--min-confidence", "0.3"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
