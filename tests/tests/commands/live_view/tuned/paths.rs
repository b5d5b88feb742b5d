use multiscopic::{DisparityMap, Frames, Result};

pub fn disparities(_: &Frames) -> Result<DisparityMap> {
    unimplemented!()
}
