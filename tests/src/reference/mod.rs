//! Independent definitions of what the product computes: plain, slow, and without any code under test.

mod around_prior;
mod block_matching;
mod disparity_network;
pub mod energy;
mod images;
mod lucas_kanade;
mod network_inputs;
pub mod networks;
pub mod semi_global;

pub use around_prior::AroundPrior;
pub use block_matching::{FusedCosts, Fusion, Match, fixed, fuse, raw16};
pub use disparity_network::DisparityNetwork;
#[cfg(target_os = "linux")]
pub use images::luma;
pub use images::{RectifiedImage, confidence, grade, gradients, medians, rectify, texture};
pub use lucas_kanade::LucasKanade;
pub use network_inputs::NetworkInputs;
