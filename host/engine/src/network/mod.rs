//! A small network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! All of its numbers are whole: activations and weights of 8 bits, sums of 32. So it has the same bits with any
//! instructions and any number of threads.
//!
//! [`multiscopic_core::network`] defines it, row by row. Here are the images, the threads and the vector instructions:
//!
//! | module | what it is |
//! | --- | --- |
//! | [`Inputs`] | the inputs of the network: the results of both passes, and the costs |
//! | [`DotProducts`] | sums of products of bytes, with the vector instructions for them |
//! | [`QuantizedLayer`] | a layer of the network |
//! | [`FloatLayer`] | a layer of other networks, in floats |
//! | [`Activations`], `operations` | the values between layers, and the operations on them |
//! | `block_disparities` | the disparities of blocks, by the costs |
//! | `look` | the result of one look at the inputs, and the combination of two |
//! | [`DisparityNetwork`] | the whole network |
//! | [`Bands`] | the whole network band by band, in less memory |

mod activations;
mod bands;
mod block_disparities;
mod disparity_network;
mod dot_products;
mod float_layer;
mod inputs;
mod look;
mod operations;
mod quantized_layer;

pub use activations::Activations;
pub use bands::Bands;
pub use disparity_network::DisparityNetwork;
pub use dot_products::DotProducts;
pub use float_layer::{Activation, FloatLayer};
pub use inputs::Inputs;
pub use quantized_layer::{QuantizedLayer, Runs};
