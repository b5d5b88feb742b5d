//! Filters of disparity lines, as they stream. Each takes lines from a matcher or from another filter.
//!
//! | module | what it is |
//! | --- | --- |
//! | `matched_lines` | the last lines from a matcher |
//! | `median_lines` | [`MedianLines`]: the median over 3 x 3 pixels |
//! | `texture_lines` | [`TextureLines`]: what has too little texture |
//! | `sure` | [`keep_sure`]: what is sure enough |

mod matched_lines;
mod median_lines;
mod sure;
mod texture_lines;

pub(crate) use matched_lines::{MatchedLines, copy_to};
pub use median_lines::MedianLines;
pub use sure::keep_sure;
pub use texture_lines::{CenterLines, SeenIn, TextureLines, slopes};
