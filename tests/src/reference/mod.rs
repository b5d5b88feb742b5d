//! Independent definitions of what the product computes: plain, slow, and without any code under test.

mod around_prior;
mod block_matching;
mod disparity_network;
pub mod energy;
mod filters;
mod lucas_kanade;
#[cfg(target_os = "linux")]
pub mod luma;
mod network_inputs;
pub mod networks;
mod rectification;
pub mod semi_global;

pub use around_prior::AroundPrior;
pub use block_matching::{FusedCosts, Fusion, Match, fixed, fuse, raw16};
pub use disparity_network::DisparityNetwork;
pub use filters::{confidence, grade, gradients, medians, texture};
pub use lucas_kanade::LucasKanade;
pub use network_inputs::NetworkInputs;
pub use rectification::{RectifiedImage, rectify};
