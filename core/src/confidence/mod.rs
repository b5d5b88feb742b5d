//! Confidence: how probable it is that a disparity is right. Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `peak_ratio` | how much worse the next best candidate is |
//! | `table` | [`ConfidenceTable`]: the probabilities by the peak ratio and by how many pixels around agree |
//! | `fitted` | the tables of the core's methods |
//! | `confidence_lines` | [`ConfidenceLines`]: confidence lines from disparity lines, a few lines later |

mod confidence_lines;
mod fitted;
mod peak_ratio;
mod table;

pub use confidence_lines::ConfidenceLines;
pub use peak_ratio::PeakRatio;
pub use table::ConfidenceTable;
