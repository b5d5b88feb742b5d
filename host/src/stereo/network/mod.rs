//! A small network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! | room | what it is |
//! | --- | --- |
//! | [`Inputs`] | what the network sees of the images: the results of both passes, and the costs |

mod feature_files;
mod inputs;

pub use inputs::Inputs;
