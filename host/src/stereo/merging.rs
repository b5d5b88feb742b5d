//! The merging of disparities that were found at several baselines, each in its own pixels, and of the evidence for them.

use multiscopic_core::SearchSpace;

use super::{confidence_map, deviation::DeviationModel};
use crate::images::{DisparityMap, Raster, nearest_disparity};

/// The evidence for disparities.
pub(super) struct Evidence {
    /// The evidence that the pipeline gives: see [`Method::confidence_table`](super::Method::confidence_table).
    pub(super) peaks: Raster<u8>,
    /// The [baselines](super::Estimate::baselines).
    pub(super) baselines: Raster<f32>,
}

impl Evidence {
    pub(super) fn none(search: &SearchSpace) -> Evidence {
        let (width, height) = (search.width(), search.height());
        Evidence { peaks: Raster::filled(width, height, 0), baselines: Raster::filled(width, height, 1.0) }
    }
}

/// The difference up to which disparities at two baselines are the same, in pixels of the unit baseline.
const SAME: f32 = 0.75;

/// The standard deviation of what the network is surest of, in pixels of the images: the median on made-up scenes.
const TYPICAL: f32 = 0.1;

/// Merges the disparities that were found at a baseline `multiple` times as long, in its own pixels, into those that were found
/// at shorter ones, and the probabilities, times 255, that they are right.
///
/// The mean counts of two that agree to [`SAME`] pixels, each weighted by the inverse of its variance, which is that of its
/// confidence in pixels of its own baseline. Of two that do not, at most one is right, and the more probable one counts.
pub(super) fn merge(
    (shorter, evidence): (&mut DisparityMap, &mut Evidence),
    multiple: u8,
    (longer, longer_sure): (&DisparityMap, &Raster<u8>),
    model: &DeviationModel,
) {
    let multiple = f32::from(multiple);
    let factor = |sure: u8| model.factors[DeviationModel::level(sure)];
    let found = longer.pixels().iter().zip(longer_sure.pixels());
    let merged = shorter.pixels_mut().iter_mut().zip(evidence.peaks.pixels_mut()).zip(evidence.baselines.pixels_mut());
    for (((disparity, sure), baseline), (far, far_sure)) in merged.zip(found) {
        let Some(far) = far.map(|far| f32::from(far) / multiple) else { continue };
        let [p, q] = [*sure, *far_sure].map(|sure| f64::from(sure) / 255.0);
        let (merged, probability, precise) = match disparity.map(f32::from) {
            None => (far, q, multiple),
            Some(near) if (near - far).abs() <= SAME => {
                // In deviations of a match at the shortest baseline.
                let precisions = [*baseline / factor(*sure), multiple / factor(*far_sure)];
                let [a, b] = precisions.map(|precision| precision.powi(2));
                // What both got wrong in the same way, the mean does not mend, and two that differ by more than their deviations
                // are less precise than they seem.
                let differs = (near - far).abs() / (TYPICAL * (1.0 / a + 1.0 / b).sqrt());
                let best = precisions[0].max(precisions[1]) / differs.max(1.0);
                ((a * near + b * far) / (a + b), p.max(q), best * factor((*sure).max(*far_sure)))
            }
            Some(near) => {
                let [near_alone, far_alone, neither] = [p * (1.0 - q), q * (1.0 - p), (1.0 - p) * (1.0 - q)];
                let is_far = far_alone > near_alone;
                let (disparity, alone, precise) = if is_far { (far, far_alone, multiple) } else { (near, near_alone, *baseline) };
                // Both cannot be certain.
                let all = near_alone + far_alone + neither;
                (disparity, if all > 0.0 { alone / all } else { 0.5 }, precise)
            }
        };
        *disparity = nearest_disparity(merged);
        *sure = confidence_map::of_probability(probability);
        *baseline = precise;
    }
}
