//! The lengths of the baselines relative to each other.

use super::track::Track;

/// The number of iterations. Each removes outliers by the scales of the one before.
const ITERATIONS: usize = 20;

/// The length of each view's baseline relative to their mean, from the disparities of the blocks that all
/// views have found. All are 1 if there is no such block.
pub fn baseline_scales(tracks: &[&Track]) -> Vec<f64> {
    let mut scales = vec![1.0; tracks.len()];
    let count = tracks.first().map_or(0, |track| track.disparities.len());
    let common_blocks: Vec<Vec<f64>> =
        (0..count).filter_map(|block| tracks.iter().map(|track| track.disparities[block]).collect()).collect();
    for _ in 0..ITERATIONS {
        // For each view, the sums of the least-squares fit `disparity = scale * mean disparity`.
        let mut sums = vec![[0.0; 2]; tracks.len()];
        for disparities in &common_blocks {
            let mut scaled: Vec<f64> = disparities.iter().zip(&scales).map(|(disparity, scale)| disparity / scale).collect();
            scaled.sort_unstable_by(f64::total_cmp);
            // Where the views disagree, as at depth edges, they see different surfaces.
            if scaled[scaled.len() - 1] - scaled[0] > 1.0 + 0.1 * scaled[0].abs() {
                continue;
            }
            let mean = scaled.iter().sum::<f64>() / scaled.len() as f64;
            for (sums, disparity) in sums.iter_mut().zip(disparities) {
                *sums = [sums[0] + disparity * mean, sums[1] + mean * mean];
            }
        }
        if sums.iter().any(|sums| sums[1] == 0.0) {
            return vec![1.0; tracks.len()];
        }
        scales = sums.iter().map(|[product, square]| product / square).collect();
        let mean = scales.iter().sum::<f64>() / scales.len() as f64;
        scales.iter_mut().for_each(|scale| *scale /= mean);
    }
    scales
}
