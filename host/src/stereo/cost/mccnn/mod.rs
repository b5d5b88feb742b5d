//! Matching costs from the networks MC-CNN, fast and accurate, with their published weights for Middlebury's
//! images.
//!
//! Žbontar and LeCun, "Stereo Matching by Training a Convolutional Neural Network to Compare Image Patches",
//! JMLR 17, 2016. The weights are those of the Python package `mccnn` (CNES, Apache-2.0), which [`package`]
//! obtains. No Python runs but pip, to download it.
//!
//! - An image is normalised to mean 0 and standard deviation 1, and extended beyond its borders by
//!   replication, as in block matching. (The package leaves out borders of 5 pixels. The paper's authors pad
//!   each layer's input with zeros and copy costs into the borders. Replication made the fewest mistakes
//!   there.)
//! - Five 3x3 convolutions compute the [`Features`] of each pixel. Their receptive field is a patch of 11x11
//!   pixels.
//! - The matching cost is 1 minus the similarity of two patches: [`Costs`]. For the fast network that is the
//!   cosine of their features. The accurate network computes it with four fully connected layers.
//! - The costs of all views are fused: [`fused_costs`]. Aggregation and optimization follow.
//!
//! Arithmetic is in `f32`. Sums are made of fused multiply-adds in a fixed order, so features and costs have
//! the same bits with AVX2, AVX-512 and Neon, and with any number of threads.

pub mod checkpoint;
mod costs;
mod network;
pub mod package;
mod weights;

pub use costs::{Costs, fused_costs};
pub use network::{Features, Input, Network};
pub use weights::{Architecture, Tensor, Weights};
