//! Evidence for a method whose costs tell little: the support of its disparities by the network.

use rayon::prelude::*;

use crate::{
    images::{DisparityMap, Raster},
    stereo::Engine,
};

/// The least support of each step of the evidence but the first. The steps are 0.6 wide in the logarithm of the odds.
const STEPS: [f32; 15] =
    [0.036, 0.063, 0.109, 0.182, 0.289, 0.426, 0.574, 0.711, 0.818, 0.891, 0.937, 0.964, 0.980, 0.989, 0.994];

/// The distance, in pixels, at which the support has fallen to a sixteenth.
const REACH: f32 = 2.6;

/// The support of disparities where the network is not sure at all, whatever the distance from its own.
const UNSURE: f32 = 0.15;

/// Returns the support that the disparities of `opinion`, with confidences `sure`, give those of `map`, in steps from 0 to 15.
///
/// # Panics
/// If the three differ in size.
pub fn support(map: &DisparityMap, opinion: &DisparityMap, sure: &Raster<u8>, engine: &Engine) -> Raster<u8> {
    for (width, height) in [(opinion.width(), opinion.height()), (sure.width(), sure.height())] {
        assert_eq!((width, height), (map.width(), map.height()), "the size of the opinion");
    }
    let mut evidence = Raster::filled(map.width(), map.height(), 0);
    engine.install(|| {
        evidence.pixels_mut().par_chunks_exact_mut(map.width()).enumerate().for_each(|(v, line)| {
            let pixels = map.row(v).iter().zip(opinion.row(v)).zip(sure.row(v));
            for (step_of, ((own, other), &sure)) in line.iter_mut().zip(pixels) {
                if let (Some(own), Some(other)) = (own, other) {
                    *step_of = step((f32::from(*own) - f32::from(*other)).abs(), f32::from(sure) / 255.0);
                }
            }
        });
    });
    evidence
}

/// The evidence for a disparity at this distance, in pixels, from that of the network, which is right with a probability of
/// `sure`.
fn step(distance: f32, sure: f32) -> u8 {
    let near = 1.0 + (distance / REACH) * (distance / REACH);
    let support = sure / (near * near * near * near) + (1.0 - sure) * UNSURE;
    STEPS.iter().filter(|least| support >= **least).count() as u8
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Disparity;

    use super::*;

    #[test]
    fn support_falls_with_the_distance_and_grows_with_what_is_sure() {
        assert_eq!([0.0, 0.5, 1.0, 1.5, 2.0, 3.0].map(|distance| step(distance, 1.0)), [15, 9, 7, 5, 3, 0]);
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(|sure| step(0.0, sure)), [3, 5, 7, 8, 15]);
    }

    #[test]
    fn what_is_invalid_has_no_support() {
        let engine = Engine::new(None, 1).expect("a pool of one thread");
        let map = Raster::new(3, 1, vec![Disparity::whole(1), None, Disparity::whole(1)]);
        let opinion = Raster::new(3, 1, vec![Disparity::whole(1), Disparity::whole(1), None]);
        let evidence = support(&map, &opinion, &Raster::filled(3, 1, 255), &engine);
        assert_eq!(evidence.pixels(), [15, 0, 0]);
    }
}
