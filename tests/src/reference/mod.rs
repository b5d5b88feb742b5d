//! Independent definitions of what the product computes: plain, slow, and without any code under test.

mod around_prior;
mod block_matching;
mod confidence;
mod disparity_network;
pub mod energy;
mod lucas_kanade;
#[cfg(target_os = "linux")]
pub mod luma;
mod network_inputs;
pub mod networks;
mod rectification;
pub mod semi_global;
mod texture;

pub use around_prior::{AroundPrior, gradients, medians};
pub use block_matching::{Fusion, Match, fixed, fuse, raw16};
pub use confidence::{confidence, grade};
pub use disparity_network::DisparityNetwork;
pub use lucas_kanade::LucasKanade;
pub use network_inputs::NetworkInputs;
pub use rectification::{RectifiedImage, rectify};
pub use texture::texture;
