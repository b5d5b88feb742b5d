//! A small network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! All of its numbers are whole: activations and weights of 8 bits, sums of 32. So it has the same bits with any
//! instructions and any number of threads.
//!
//! [`multiscopic_core::network`] defines it, row by row. Here are the images, the threads and the vector instructions:
//!
//! | room | what it is |
//! | --- | --- |
//! | [`Inputs`] | what the network sees of the images: the results of both passes, and the costs |
//! | [`DotProducts`] | sums of products of bytes, with the vector instructions for them |
//! | [`QuantizedLayer`] | a layer of the network |
//! | [`Activations`], `operations` | what goes from layer to layer, and how |
//! | `block_disparities` | the disparities of blocks, by the costs |
//! | `look` | what the network finds, once and in two looks |
//! | [`DisparityNetwork`] | all of it |
//! | [`Bands`] | the same band by band |

mod activations;
mod bands;
mod block_disparities;
mod disparity_network;
mod dot_products;
mod inputs;
mod look;
mod operations;
mod quantized_layer;

pub use activations::Activations;
pub use bands::Bands;
pub use disparity_network::DisparityNetwork;
pub use dot_products::DotProducts;
pub use inputs::Inputs;
pub use quantized_layer::{QuantizedLayer, Runs};
