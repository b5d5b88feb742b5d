//! Refinement: checks and filters of the selected disparities.

mod background;
mod bilateral;
mod left_right;
mod line_solver;
mod lucas_kanade;
mod median;
mod refinements;
mod smoother;
mod speckles;
mod texture_threshold;
mod uniqueness;
mod window;

pub(in crate::stereo) use background::fill_lines;

pub use background::BackgroundFill;
pub use bilateral::Bilateral;
pub use left_right::{check_left_right, view_disparities};
pub use lucas_kanade::LucasKanade;
pub use median::Median;
pub use refinements::Refinement;
pub use smoother::Smoother;
pub use speckles::Speckles;
pub use texture_threshold::TextureThreshold;
pub use uniqueness::keep_unique;
