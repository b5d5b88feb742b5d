//! Filters of disparity lines, as they stream. Each takes lines from a matcher or from another filter.
//!
//! | room | what it is |
//! | --- | --- |
//! | `matched_lines` | the last lines from a matcher |
//! | `median_lines` | [`MedianLines`]: the median over 3 x 3 pixels |
//! | `sure` | [`keep_sure`]: what is sure enough |

mod matched_lines;
mod median_lines;
mod sure;

pub(crate) use matched_lines::MatchedLines;
pub use median_lines::MedianLines;
pub use sure::keep_sure;
