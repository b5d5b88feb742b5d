//! A small network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! All of its numbers are whole: activations and weights of 8 bits, sums of 32. So it has the same bits with any
//! instructions and any number of threads.
//!
//! | room | what it is |
//! | --- | --- |
//! | [`Inputs`] | what the network sees of the images: the results of both passes, and the costs |
//! | [`DotProducts`] | sums of products of bytes, with the vector instructions for them |
//! | [`QuantizedLayer`] | a layer of the network |
//! | [`Activations`], `operations` | what goes from layer to layer, and how |
//! | `block_disparities` | the disparities of blocks, by the costs |
//! | `pixel_channels`, `pixel_head` | the first and the last step by pixels |
//! | `look` | what the network finds, once and in two looks |
//! | `weight_file` | the file with the weights |
//! | [`DisparityNetwork`] | all of it |

mod activations;
mod block_disparities;
mod disparity_network;
mod dot_products;
mod exponentials;
mod inputs;
mod look;
mod operations;
mod pixel_channels;
mod pixel_head;
mod quantized_layer;
mod weight_file;

pub use activations::Activations;
pub use disparity_network::DisparityNetwork;
pub use dot_products::DotProducts;
pub use inputs::Inputs;
pub use quantized_layer::{Output, QuantizedLayer, Runs, Scale};
