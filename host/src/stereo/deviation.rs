//! Standard deviations: how precise a disparity is, for every pixel.
//!
//! A [confidence](super::confidence_map) says that a disparity is right or wrong, a deviation how far off it is. It is half of
//! the error that 95 % of the disparities stay below that look like this one, so that the truth is within two deviations as
//! often as that of a normal distribution. Where a mismatch is not unlikely, it is large.
//!
//! The variance is the sum of what can be measured at a pixel, each [term](Terms) with a weight, and the deviation is its root
//! times a factor that depends on the confidence. A [`DeviationModel`] of the method has both, fitted on made-up scenes.

use multiscopic_core::Views;

use super::{
    confidence_map::ConfidenceMap,
    refinement::{Fit, LucasKanade},
};
use crate::images::{DisparityMap, FloatImage, Frames, Raster};

/// The weights and factors of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviationModel {
    /// The weights of the [terms](Terms::of_pixel).
    pub weights: [f32; Terms::COUNT],
    /// The factors of the roots, by sixteenths of the confidence. They do not rise.
    pub factors: [f32; DeviationModel::LEVELS],
}

impl DeviationModel {
    /// The number of levels of confidence.
    pub const LEVELS: usize = 16;

    /// The level of a confidence.
    pub fn level(confidence: u8) -> usize {
        usize::from(confidence) * DeviationModel::LEVELS / 256
    }

    /// The variance of the terms of a pixel in square pixels, before the factor.
    pub fn variance(&self, terms: &[f32; Terms::COUNT]) -> f32 {
        self.weights.iter().zip(terms).map(|(weight, term)| weight * term).sum()
    }
}

/// The terms of disparities' variances.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms {
    fits: Raster<Fit>,
    /// The squared misalignment of the views over their number, in square pixels.
    misalignment: f32,
}

/// Returns the terms of the disparities of the centre of `frames`, found by `views` with these confidences. Computed on the
/// threads of the current pool.
///
/// # Panics
/// If the sizes differ, or a view is missing.
pub fn terms(map: &DisparityMap, confidences: &ConfidenceMap, frames: &Frames, views: Views) -> Terms {
    let is_likely = |at: usize| confidences.pixels()[at] >= 128;
    let (fits, misalignment) = LucasKanade.fit(map, is_likely, frames, views);
    Terms { fits, misalignment: misalignment * misalignment / views.len().max(1) as f32 }
}

impl Terms {
    /// The number of terms of a pixel.
    pub const COUNT: usize = 6;

    /// The terms of a pixel, by its place in the map row by row: 1 for what is the same everywhere, the squares of noise, step
    /// and roughness of its [`Fit`], its share of an edge, and the squared misalignment over the number of views.
    pub fn of_pixel(&self, at: usize) -> [f32; Terms::COUNT] {
        let Fit { step, noise, roughness, edge } = self.fits.pixels()[at];
        [1.0, noise * noise, step * step, roughness * roughness, edge, self.misalignment]
    }

    /// Returns the standard deviations of disparities in pixels, +inf where invalid.
    pub fn deviations(&self, map: &DisparityMap, confidences: &ConfidenceMap, model: &DeviationModel) -> FloatImage {
        let pixels = map.pixels().iter().zip(confidences.pixels()).enumerate();
        let deviation = |(at, (disparity, confidence)): (usize, (&Option<_>, &u8))| match disparity {
            Some(_) => model.factors[DeviationModel::level(*confidence)] * model.variance(&self.of_pixel(at)).sqrt(),
            None => f32::INFINITY,
        };
        FloatImage::new(map.width(), map.height(), pixels.map(deviation).collect())
    }
}

/// Block matching.
pub const BLOCK_MATCHING: DeviationModel = DeviationModel {
    weights: [0.11, 0.0163, 0.000015, 0.000015, 0.0605, 17.6],
    factors: [15.6, 15.6, 15.6, 15.6, 15.6, 15.6, 15.5, 15.1, 15.1, 15.1, 12.7, 12.7, 12.2, 6.49, 2.43, 1.0],
};
/// Semi-global matching.
pub const SEMI_GLOBAL: DeviationModel = DeviationModel {
    weights: [0.144, 0.0469, 0.139, 0.000040, 0.000008, 11.6],
    factors: [14.0, 14.0, 14.0, 14.0, 14.0, 12.7, 12.7, 11.4, 10.9, 10.9, 10.2, 8.11, 4.77, 3.01, 1.79, 1.0],
};
/// Graph cuts.
pub const GRAPH_CUTS: DeviationModel = DeviationModel {
    weights: [0.0968, 0.0, 0.0, 0.315, 0.0, 31.0],
    factors: [20.3, 20.3, 20.3, 19.3, 15.7, 15.7, 15.7, 15.7, 15.7, 15.7, 10.8, 10.8, 6.81, 6.81, 2.24, 1.0],
};
/// The network.
pub const NETWORK: DeviationModel = DeviationModel {
    weights: [0.0391, 0.0, 0.0, 8.13, 0.0, 65.1],
    factors: [18.5, 18.5, 16.3, 16.3, 16.3, 15.9, 15.9, 15.9, 15.9, 14.0, 13.5, 10.5, 5.82, 3.61, 1.85, 1.0],
};

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Disparity;

    /// Pixels that are less sure are not more precise, nor are those that have more of any term.
    #[test]
    fn deviations_grow_with_doubt() {
        for model in [BLOCK_MATCHING, SEMI_GLOBAL, GRAPH_CUTS, NETWORK] {
            assert!(model.factors.is_sorted_by(|less_sure, surer| less_sure >= surer), "{model:?}");
            assert!(model.weights.iter().all(|weight| *weight >= 0.0) && model.weights[0] > 0.0, "{model:?}");
        }
    }

    #[test]
    fn a_deviation_is_the_root_of_weighted_terms_times_a_factor() {
        let fit = Fit { step: 0.5, noise: 2.0, roughness: 1.0, edge: 0.25 };
        let terms = Terms { fits: Raster::filled(3, 1, fit), misalignment: 3.0 };
        let mut factors = [2.0; DeviationModel::LEVELS];
        factors[15] = 1.0;
        let model = DeviationModel { weights: [1.0, 0.5, 4.0, 0.0, 8.0, 1.0], factors };
        let map = DisparityMap::new(3, 1, vec![Disparity::whole(3), None, Disparity::whole(9)]);
        let found = terms.deviations(&map, &ConfidenceMap::new(3, 1, vec![240, 0, 239]), &model);
        // 1 + 2 + 1 + 0 + 2 + 3
        assert_eq!(found.pixels(), [3.0, f32::INFINITY, 6.0]);
    }
}
