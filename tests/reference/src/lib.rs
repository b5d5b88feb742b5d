//! Independent definitions of what the product computes: plain, slow, and without any code under test, which this crate does not
//! depend on.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`split_mix`] | random numbers that are the same everywhere |
//! | `images` | single images and maps: gradients, medians, texture, confidence, rectification |
//! | `block_matching` | block matching, and the fusion of the views' costs |
//! | `around_prior` | block matching around a prior |
//! | [`semi_global`] | semi-global matching, and census |
//! | [`energy`] | the energy that graph cuts minimise |
//! | `lucas_kanade` | sub-pixel refinement by Lucas and Kanade |
//! | [`networks`] | MC-CNN |
//! | `network_inputs` | the inputs of the disparity network |
//! | `disparity_network` | the disparity network |
//! | `sweep` | the filter over the frames of a sweep |
//! | [`board_photos`] | photos of a board through a lens |

mod around_prior;
mod block_matching;
pub mod board_photos;
mod disparity_network;
pub mod energy;
mod images;
mod lucas_kanade;
mod network_inputs;
pub mod networks;
pub mod semi_global;
pub mod split_mix;
mod sweep;

pub use around_prior::AroundPrior;
pub use block_matching::{FusedCosts, Fusion, Match, fixed, fuse, raw16, trimmed};
pub use disparity_network::DisparityNetwork;
pub use images::{RectifiedImage, confidence, grade, grade_at, gradients, medians, rectify, texture};
pub use lucas_kanade::LucasKanade;
pub use network_inputs::NetworkInputs;
pub use sweep::{State, Sweep};
