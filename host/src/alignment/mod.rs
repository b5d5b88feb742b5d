//! Estimating and correcting how far each view is from where it should be.
//!
//! A camera that is moved by hand or by a cheap slide, or is not square to the slide, gives views that lie a
//! little off the baseline, with baselines of different lengths and different brightness. Matching searches
//! along the baseline only, and compares grey values, so it suffers from all of these. The estimate has three
//! numbers for each view: the shift across the baseline, the gain in brightness, and the length of the
//! baseline relative to the other views.
//!
//! The whole pixels of the shift are found by block matching at every shift: the best one has the lowest
//! cost. The fraction comes from least squares over small blocks, as in the optical flow of Lucas and Kanade
//! (1981). The blocks share two unknowns, the shift and the gain. Each block also has an unknown of its own,
//! the position of its match along the baseline, which is eliminated.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `direction` | the directions along and across a baseline |
//! | `interpolated` | an image addressed between pixels |
//! | `correction` | shifting a view across its baseline and dividing by its gain |
//! | `coarse_shift` | the shift in whole pixels |
//! | `normal_equations` | what one block contributes to least squares |
//! | `track` | the shift, the gain and the positions of all blocks in one view |
//! | `baseline_scales` | the lengths of the baselines relative to each other |
//! | `estimate` | all of these for a capture: [`Alignment`] |

mod baseline_scales;
mod coarse_shift;
mod correction;
mod direction;
mod estimate;
mod interpolated;
mod normal_equations;
mod residual;
mod track;

pub use coarse_shift::MAX_SHIFT;
pub use estimate::Alignment;
pub use residual::Residual;
