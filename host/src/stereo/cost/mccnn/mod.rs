//! Matching costs from the networks MC-CNN, fast and accurate, with their published weights for Middlebury's images.
//!
//! Žbontar and LeCun, "Stereo Matching by Training a Convolutional Neural Network to Compare Image Patches", JMLR 17, 2016. The
//! weights are those of the Python package `mccnn` (CNES, Apache-2.0), which [`package`] obtains. No Python runs but pip, to
//! download it.
//!
//! - An image is normalised to mean 0 and standard deviation 1, and extends beyond its borders by replication, as it does for
//!   block matching. (The package leaves out borders of 5 pixels; the paper's authors put zeros around each layer's input and
//!   copy costs into the borders. Replication made the fewest mistakes there.)
//! - Five convolutions of 3x3 pixels describe the patch of 11x11 around each pixel: [`Features`].
//! - The cost of a match is 1 minus the similarity of two patches. The fast network takes the cosine between their features, the
//!   accurate one asks four more layers: [`Costs`].
//! - The costs of all views are fused: [`fused_costs`]. Aggregation and optimization follow.
//!
//! Arithmetic is in `f32`. Sums are fused and have a fixed order: features and costs are the same bits with AVX2, AVX-512 and
//! Neon, and with any number of threads.

pub mod checkpoint;
mod costs;
mod features;
mod fused;
mod layer;
mod network;
pub mod package;
mod weights;

pub use costs::Costs;
pub use features::Features;
pub use fused::fused_costs;
pub use network::{Input, Network};
pub use weights::{Architecture, Tensor, Weights};
