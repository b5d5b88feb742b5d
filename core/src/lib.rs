//! Streaming multiscopic block matching in fixed point and bounded memory.
#![no_std]

mod availability;
mod disparity;
mod fusion;
pub mod kernel;
mod lines;
mod matcher;
mod memory;
mod params;
mod region;
mod scanline;
mod selection;
mod view;

pub use fixed;

pub use disparity::Disparity;
pub use fusion::Fusion;
pub use matcher::{MatchError, Matcher, MemoryTooSmall};
pub use memory::Memory;
pub use params::{Params, ParamsError};
pub use region::{Region, RegionError};
pub use scanline::{Rewind, ScanlineSource};
pub use view::{Frame, View, Views};
