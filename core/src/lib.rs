//! Multiscopic block matching for microcontrollers and hosts: scanlines in, disparity lines out, in fixed
//! point and bounded memory.
//!
//! One camera is moved in its image plane and takes a centre image and up to four neighbours, one baseline
//! away to the left, right, top and bottom. A point has the same disparity to each of them, so the matching
//! costs of the pairs are fused into one. The method is that of *Active Perception with A Monocular Camera
//! for Multiscopic Vision* (Yuan, Fan, Wang, Chen). The documentation of [`View`], [`Fusion`], [`Search`],
//! [`Params`] and [`Disparity`] defines the result, bit for bit.
//!
//! Data flows down this list, and each room knows only those above it:
//!
//! | room | what it is |
//! | --- | --- |
//! | `view` | [`View`], [`Views`], [`Frame`]: where the camera was, and where matches lie |
//! | `fusion` | [`Fusion`]: how the matching costs of several views become one |
//! | `disparity` | [`Disparity`]: fixed point, and sub-pixel refinement |
//! | `depth` | [`Triangulation`], [`Depth`]: from disparity to distance |
//! | `search` | [`Search`]: frames, views and search range, whatever the method |
//! | `params` | [`Params`]: a search by block matching |
//! | `region` | [`Region`]: the part of the frame that a pass computes |
//! | `scanline` | [`ScanlineSource`], [`Rewind`]: where lines come from, such as memory, flash, a file or a sensor |
//! | `availability` | the frame's borders: which views see a candidate |
//! | [`kernel`] | the inner loops, for the vectors of each instruction set |
//! | `memory` | [`Memory`]: the bytes of each buffer, which the caller lends |
//! | `matcher` | [`Matcher`]: pulls lines, and computes disparity lines |
//! | [`capture`] | how the frames are taken: the camera moves, settles and captures |
//!
//! The crate does not allocate, panic or recurse. Unsafe code is confined to modules of [`kernel`], each of
//! which states why it is sound.
//!
//! # Features
//! `defmt`: parameters, results and errors implement `defmt::Format`.
#![no_std]

mod availability;
pub mod capture;
mod depth;
mod disparity;
mod fusion;
pub mod kernel;
mod matcher;
mod memory;
mod params;
mod region;
mod scanline;
mod search;
mod view;

pub use fixed;

pub use depth::{Depth, Triangulation};
pub use disparity::Disparity;
pub use fusion::{Fusion, MatchingCost};
pub use matcher::{MatchError, Matcher, MemoryTooSmall};
pub use memory::Memory;
pub use params::Params;
pub use region::{Region, RegionError};
pub use scanline::{Rewind, ScanlineSource};
pub use search::{ParamsError, Search};
pub use view::{Frame, View, Views};
