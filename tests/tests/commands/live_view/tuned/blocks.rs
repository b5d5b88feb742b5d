use multiscopic::{DisparityMap, Engine, Frames, Method, Result, stereo, stereo::refinement};
use multiscopic_core::{Fusion, SearchConfig};

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {
    let [width, height] = frames.size().map(|side| side as u16);
    let range = SearchConfig { min_disparity: -2, num_disparities: 40, ..SearchConfig::of_size(width, height) };
    let search = SearchConfig { views: frames.views(), fusion: Fusion::Mean, ..range }.checked()?;
    let pipeline = stereo::Pipeline::BlockMatching { block_size: 9 };
    let mut method = Method::new(pipeline);
    method.refinement.uniqueness = Some(5);
    method.refinement.left_right = Some(2);
    method.refinement.texture = Some(refinement::TextureThreshold { threshold: 100, block_size: 9 });
    method.refinement.median = Some(refinement::Median::new(5)?);
    method.refinement.speckles = Some(refinement::Speckles { window_size: 30, range: 2 });
    method.refinement.sub_pixel = Some(refinement::LucasKanade);
    method.refinement.min_confidence = Some(77);
    method.disparities(&Engine::new(None, 0)?, frames, &search, &())
}
