//! Multiscopic block matching and semi-global matching for microcontrollers and hosts: scanlines in, disparity
//! lines out, in fixed point and bounded memory.
//!
//! One camera is moved in its image plane and takes a centre image and neighbours, whole baselines away to the left,
//! right, top and bottom. A point has the same disparity for each baseline to all of them, so the matching costs of
//! the pairs are fused into one. The method is that of *Active Perception with A Monocular Camera
//! for Multiscopic Vision* (Yuan, Fan, Wang, Chen). The documentation of [`View`], [`Fusion`], [`Search`],
//! [`Params`] and [`Disparity`] defines the result, bit for bit.
//!
//! Data flows down this list, and each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `view` | [`View`], [`Frame`]: where the camera was, and where matches lie |
//! | `views` | [`Views`]: a set of views, in order |
//! | `fusion` | [`Fusion`]: how the matching costs of several views become one |
//! | `disparity` | [`Disparity`]: fixed point, and sub-pixel refinement |
//! | `depth` | [`Triangulation`], [`Depth`]: from disparity to distance |
//! | `params` | [`Search`], [`Params`], [`SemiGlobalParams`]: what is searched, and by which method |
//! | `error` | [`MatchError`], [`MemoryTooSmall`]: why lines could not be matched |
//! | `region` | [`Region`]: the part of the frame that a pass computes |
//! | `scanline` | [`ScanlineSource`], [`Rewind`]: where lines come from, such as memory, flash, a file or a sensor |
//! | `gradients` | [`Gradients`]: the gradients of a source's lines |
//! | `prior_line` | a line of the disparities around which is searched |
//! | `availability` | the frame's borders: which views see a candidate |
//! | [`kernel`] | the inner loops, for the vectors of each instruction set |
//! | `memory` | [`Memory`]: the bytes of each buffer, which the caller lends |
//! | `rectification` | [`Rectification`], [`Rectified`]: a source's lines without the camera's distortion and tilt |
//! | `lines` | the lines of all frames that a line is compared with |
//! | `filters` | [`TextureLines`], [`MedianLines`], [`keep_sure`]: filters of disparity lines |
//! | `confidence` | [`ConfidenceTable`], [`ConfidenceLines`]: how probable it is that a disparity is right |
//! | `matcher` | [`Matcher`]: pulls lines, and computes disparity lines by block matching |
//! | `semi_global` | [`SemiGlobalMatcher`]: the same by semi-global matching |
//! | `network` | with the feature `network`: the learned network, and how it runs in bounded memory |
//! | [`capture`] | how the frames are taken: the camera moves, settles and captures |
//!
//! The crate does not allocate, panic or recurse. Unsafe code is confined to modules of [`kernel`], each of
//! which states why it is sound.
//!
//! # Features
//! `array`: matchers take up to eight views instead of four.
//!
//! `defmt`: parameters, results and errors implement `defmt::Format`.
//!
//! `network`: the learned network with its weights, 182 kB, and `EightPaths`.
#![no_std]

mod availability;
pub mod capture;
mod confidence;
mod depth;
mod disparity;
mod error;
mod filters;
mod fusion;
mod gradients;
pub mod kernel;
mod lines;
mod matcher;
mod memory;
#[cfg(feature = "network")]
pub mod network;
mod params;
mod prior_line;
mod rectification;
mod region;
mod scanline;
mod semi_global;
mod view;
mod views;

pub use fixed;

pub use confidence::{ConfidenceLines, ConfidenceTable, PeakRatio};
pub use depth::{Depth, Triangulation};
pub use disparity::Disparity;
pub use error::{MatchError, MemoryTooSmall};
pub use filters::{CenterLines, MedianLines, SeenIn, TextureLines, keep_sure, slopes};
pub use fusion::{Fusion, MatchingCost};
pub use gradients::Gradients;
pub use matcher::Matcher;
pub use memory::Memory;
pub use params::{Census, Params, ParamsError, PathPenalties, Prior, Search, SearchConfig, SemiGlobalCost, SemiGlobalParams};
pub use rectification::{Displacement, DisplacementGrid, Rectification, RectificationError, Rectified, RectifiedError};
pub use region::{Region, RegionError};
pub use scanline::{Rewind, ScanlineSource};
#[cfg(feature = "network")]
pub use semi_global::{EightPaths, EightPathsLine};
pub use semi_global::{PathWinners, SemiGlobalMatcher};
pub use view::{Frame, ParseViewError, View, ViewError};
pub use views::Views;
