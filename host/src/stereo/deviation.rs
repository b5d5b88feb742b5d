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
    baselines::BaselineRefinement,
    confidence_map::ConfidenceMap,
    refinement::{Fit, LucasKanade},
};
use crate::images::{DisparityMap, FloatImage, Frames, Raster};

/// The weights and factors of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviationModel {
    /// The weights of the [terms](Terms::of_pixel).
    pub weights: [f32; Terms::COUNT],
    /// The factors of the roots, by the [level](DeviationModel::level) of the confidence. They do not rise.
    pub factors: [f32; DeviationModel::LEVELS],
}

impl DeviationModel {
    /// The number of levels of confidence.
    pub const LEVELS: usize = 16;

    /// The level of a confidence: doubts, 255 less the confidence, are told apart to half an octave, since among those who are
    /// surest, errors still differ by ten times.
    pub fn level(confidence: u8) -> usize {
        /// The greatest doubts of the levels but the lowest.
        const DOUBTS: [u8; DeviationModel::LEVELS - 1] = [192, 128, 96, 64, 48, 32, 24, 16, 12, 8, 6, 4, 3, 2, 1];
        DOUBTS.partition_point(|doubt| 255 - confidence <= *doubt)
    }

    /// The variance of the terms of a pixel in square pixels, before the factor.
    pub fn variance(&self, terms: &[f32; Terms::COUNT]) -> f32 {
        self.weights.iter().zip(terms).map(|(weight, term)| weight * term).sum()
    }
}

/// The terms of disparities' variances: those of each baseline, the shortest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms(Vec<TermsOfBaseline>);

/// The terms by the views at one baseline.
#[derive(Clone, Debug, PartialEq)]
struct TermsOfBaseline {
    /// The baseline, in multiples of the shortest.
    multiple: f32,
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
    let of_baseline = |(n, views): (usize, Views)| {
        let (fits, misalignment) = LucasKanade.fit(map, is_likely, frames, views);
        let misalignment = misalignment * misalignment / views.len().max(1) as f32;
        // The first are matched in pixels of the shortest baseline, wherever they are.
        let multiple = if n == 0 { 1.0 } else { views.multiple().into() };
        TermsOfBaseline { multiple, fits, misalignment }
    };
    Terms(BaselineRefinement::sets(views).into_iter().enumerate().map(of_baseline).collect())
}

impl Terms {
    /// The number of terms of a pixel.
    pub const COUNT: usize = 6;

    /// The terms of a pixel, by its place in the map row by row, that was measured at a `baseline`, in pixels of that baseline: 1
    /// for what is the same everywhere, the squares of noise, step and roughness of its [`Fit`], its share of an edge, and the
    /// squared misalignment over the number of views.
    pub fn of_pixel(&self, at: usize, baseline: f32) -> [f32; Terms::COUNT] {
        let Some(TermsOfBaseline { multiple, fits, misalignment }) =
            self.0.iter().find(|terms| terms.multiple >= baseline).or(self.0.last())
        else {
            return [f32::INFINITY; Terms::COUNT];
        };
        let Fit { step, noise, roughness, edge } = fits.pixels()[at];
        let square = |pixels: f32| (multiple * pixels).powi(2);
        [1.0, square(noise), square(step), square(roughness), edge, *misalignment]
    }

    /// Returns the standard deviations of disparities in pixels, +inf where invalid, which were measured at these baselines.
    pub fn deviations(
        &self,
        map: &DisparityMap,
        confidences: &ConfidenceMap,
        baselines: &Raster<f32>,
        model: &DeviationModel,
    ) -> FloatImage {
        let pixels = map.pixels().iter().zip(confidences.pixels()).zip(baselines.pixels()).enumerate();
        let deviation = |(at, ((disparity, confidence), baseline)): (usize, ((&Option<_>, &u8), &f32))| match disparity {
            Some(_) => {
                model.factors[DeviationModel::level(*confidence)] * model.variance(&self.of_pixel(at, *baseline)).sqrt()
                    / baseline
            }
            None => f32::INFINITY,
        };
        FloatImage::new(map.width(), map.height(), pixels.map(deviation).collect())
    }
}

/// Block matching.
pub const BLOCK_MATCHING: DeviationModel = DeviationModel {
    weights: [0.0543, 0.109, 1.77, 0.441, 0.0, 3.53],
    factors: [22.7, 22.7, 22.7, 22.7, 20.2, 15.5, 7.91, 5.44, 3.43, 1.98, 1.32, 1.12, 1.12, 1.0, 1.0, 1.0],
};
/// Semi-global matching.
pub const SEMI_GLOBAL: DeviationModel = DeviationModel {
    weights: [0.0337, 0.135, 0.0, 0.421, 0.00752, 4.5e-6],
    factors: [28.8, 25.2, 24.9, 22.1, 17.1, 11.8, 7.87, 6.07, 4.21, 3.18, 2.66, 1.63, 1.21, 1.0, 1.0, 1.0],
};
/// Graph cuts.
pub const GRAPH_CUTS: DeviationModel = DeviationModel {
    weights: [0.0124, 0.0992, 1.24, 0.954, 0.992, 0.734],
    factors: [30.7, 13.3, 13.3, 12.8, 12.6, 9.73, 9.73, 3.79, 2.98, 2.62, 2.50, 1.70, 1.11, 1.0, 1.0, 1.0],
};
/// The network.
pub const NETWORK: DeviationModel = DeviationModel {
    weights: [0.00580, 0.0232, 0.580, 1.51, 0.0580, 4.64],
    factors: [44.4, 34.5, 31.6, 26.5, 16.9, 9.69, 6.35, 4.78, 3.82, 3.15, 2.52, 2.19, 1.87, 1.66, 1.38, 1.0],
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
        let of_baseline = |multiple| TermsOfBaseline { multiple, fits: Raster::filled(3, 1, fit), misalignment: 3.0 };
        let terms = Terms(vec![of_baseline(1.0), of_baseline(2.0)]);
        let mut factors = [2.0; DeviationModel::LEVELS];
        factors[15] = 1.0;
        let model = DeviationModel { weights: [1.0, 0.5, 4.0, 0.0, 8.0, 1.0], factors };
        let map = DisparityMap::new(3, 1, vec![Disparity::whole(3), None, Disparity::whole(9)]);
        let confidences = ConfidenceMap::new(3, 1, vec![254, 0, 253]);
        // 1 + 2 + 1 + 0 + 2 + 3, and 1 + 4 (2 + 1) + 0 + 2 + 3 at two baselines.
        let baselines = Raster::new(3, 1, vec![1.0, 1.0, 2.0]);
        let found = terms.deviations(&map, &confidences, &baselines, &model);
        assert_eq!(found.pixels(), [3.0, f32::INFINITY, 18f32.sqrt()]);
    }
}
