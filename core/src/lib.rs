//! Streaming multiscopic block matching in fixed point and bounded memory.
#![no_std]

mod disparity;
mod fusion;
mod params;
mod scanline;
mod view;

pub use fixed;

pub use disparity::Disparity;
pub use fusion::Fusion;
pub use params::{Params, ParamsError};
pub use scanline::{Rewind, ScanlineSource};
pub use view::{Frame, View, Views};
