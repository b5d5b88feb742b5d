//! Matching costs of frames that lie whole in memory.
//!
//! | module | what it is |
//! | --- | --- |
//! | `line_rings` | extended lines of a frame, and their transform |
//! | `blurred_lines` | lines of the blurred frame |
//! | `candidate_planes` | the descriptors of a view's line, by candidate |
//! | `census_pair_lines` | [`CensusPairLines`]: matching costs by two census transforms |

mod blurred_lines;
mod candidate_planes;
mod census_pair_lines;
mod line_rings;

pub use census_pair_lines::{CensusPair, CensusPairLines};
