//! Multiscopic block matching for microcontrollers and hosts: scanlines in, disparity lines out, in fixed point and bounded memory.
//!
//! One camera is moved in its image plane and takes a centre image and up to four neighbours, one baseline away to the left, right, top
//! and bottom. A point has the same disparity to each, so the pairs' matching costs are fused into one. The method is that of
//! *Active Perception with A Monocular Camera for Multiscopic Vision* (Yuan, Fan, Wang, Chen); what exactly is computed is defined
//! by the documentation of [`View`], [`Params`], [`Fusion`] and [`Disparity`], bit for bit.
//!
//! Data flows down this list, and no item knows those below it:
//!
//! | item | what it is |
//! | --- | --- |
//! | [`View`], [`Views`], [`Frame`] | where the camera was |
//! | [`Fusion`], [`Search`], [`Params`], [`Region`] | what is matched, and how |
//! | [`Memory`] | how many bytes that takes: the caller lends them |
//! | [`ScanlineSource`], [`Rewind`] | where lines come from: memory, flash, a file, a sensor |
//! | [`kernel`] | the inner loops, once, over the vectors of any instruction set |
//! | [`Matcher`] | pulls lines and gives disparity lines |
//! | [`Disparity`], [`Triangulation`], [`Depth`] | what comes out |
//! | [`capture`] | how the frames are taken: the camera is moved, settles, captures |
//!
//! The crate does not allocate, panic or recurse, and has no unsafe code but in the modules of vector instructions.
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
