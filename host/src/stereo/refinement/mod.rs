//! Refinement: checks and filters of the selected disparities.

mod bilateral;
mod left_right;
mod median;
mod refinements;
mod window;

pub use bilateral::Bilateral;
pub use median::Median;
pub use refinements::Refinement;
