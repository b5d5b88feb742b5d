//! The code that the page of `tune` gives for some settings, as it stands there. A test compares it, compiles it and runs it.

pub mod blocks {
use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "bm", "--fusion", "mean", "--min-disparity", "-2", "--num-disparities", "40", "--block-size", "9", "--uniqueness-ratio", "5", "--disp12-max-diff", "2", "--texture-threshold", "100", "--median", "5", "--speckle-window-size", "30", "--speckle-range", "2", "--sub-pixel", "lucas-kanade", "--min-confidence", "0.3"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
}

pub mod paths {
use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "sgm", "--num-disparities", "40", "--cost", "census2", "--census", "7x7", "--p1", "5", "--p2", "30", "--p2-edge", "12", "--paths", "8", "--smooth"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
}

pub mod cuts {
use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "gc", "--num-disparities", "16", "--occlusion-cost", "12", "--lambda1", "4", "--smoothness", "potts", "--sweeps", "2"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
}

pub mod network {
use multiscopic::{DisparityMap, Engine, Frames, Method, Result};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let options = MatchingOptions::parse(["--method", "net", "--num-disparities", "40", "--fill", "background"])?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
}
