//! The filter by confidence.

use crate::Disparity;

/// Invalidates the disparities of a line that are less sure than `least`, a probability times 255. What is invalid has the
/// confidence 0.
pub fn keep_sure(least: u8, disparities: &mut [Option<Disparity>], confidences: &mut [u8]) {
    for (disparity, confidence) in disparities.iter_mut().zip(confidences) {
        *disparity = disparity.filter(|_| *confidence >= least);
        if disparity.is_none() {
            *confidence = 0;
        }
    }
}
