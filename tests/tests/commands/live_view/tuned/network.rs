use multiscopic::{DisparityMap, Engine, Frames, Method, Result, stereo::refinement};
use multiscopic_core::{Fusion, SearchConfig};

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let [width, height] = frames.size().map(|side| side as u16);
    let range = SearchConfig { min_disparity: 1, num_disparities: 40, ..SearchConfig::of_size(width, height) };
    let search = SearchConfig { views: frames.views(), fusion: Fusion::Heuristic, ..range }.checked()?;
    let mut method = Method::net();
    method.refinement.sub_pixel = Some(refinement::LucasKanade);
    method.refinement.repair = Some(refinement::Smoother::REGIONAL);
    method.refinement.fill = Some(refinement::BackgroundFill);
    method.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
