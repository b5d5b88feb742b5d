//! Filters of disparity lines, as they stream. Each takes lines from a matcher or from another filter.
//!
//! | module | what it is |
//! | --- | --- |
//! | `median_lines` | the last lines from a matcher, and [`MedianLines`]: the median over 3 x 3 pixels |
//! | `texture_lines` | [`TextureLines`]: removes disparities where there is too little texture |

mod median_lines;
mod texture_lines;

use crate::Disparity;
pub use median_lines::MedianLines;
pub(crate) use median_lines::{MatchedLines, copy_to};
pub use texture_lines::{CenterLines, ObservedSource, TextureLines, slopes};

/// Invalidates the disparities of a line that are less sure than `least`, a probability times 255. An invalid pixel has
/// the confidence 0.
pub fn filter_by_confidence(least: u8, disparities: &mut [Option<Disparity>], confidences: &mut [u8]) {
    for (disparity, confidence) in disparities.iter_mut().zip(confidences) {
        *disparity = disparity.filter(|_| *confidence >= least);
        if disparity.is_none() {
            *confidence = 0;
        }
    }
}
