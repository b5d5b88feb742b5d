//! Multiscopic block matching and semi-global matching for microcontrollers and hosts: scanlines in, disparity
//! lines out, in fixed point and bounded memory.
//!
//! Implement [`ScanlineSource`] for what holds your frames, say what to search in a [`SearchConfig`], lend a matcher its
//! memory, and take disparity lines from it:
//!
//! ```
//! use multiscopic_core::{Frame, Fusion, Matcher, ScanlineSource, SearchConfig, Views};
//!
//! /// Frames in memory, in flash, in a file or on a sensor. Here: a ramp, seen three pixels further in both views.
//! struct Ramp;
//!
//! impl ScanlineSource for Ramp {
//!     type Error = core::convert::Infallible;
//!
//!     fn read_line(&mut self, frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
//!         let shift = if let Frame::View(view) = frame { view.shift(3).0 } else { 0 };
//!         line.iter_mut().zip(0..).for_each(|(pixel, u)| *pixel = (5 * (u - shift)).clamp(0, 255) as u8);
//!         Ok(())
//!     }
//! }
//!
//! let search = SearchConfig { num_disparities: 8, ..SearchConfig::of_size(40, 30) };
//! let params = SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, ..search }.block_matching(5)?;
//! let mut memory = vec![0; params.memory_words()]; // in firmware a static array of a constant length
//! let mut matcher = Matcher::new(&params, &mut memory)?;
//! let mut line = [None; 40];
//! while let Some(v) = matcher.next_line(&mut Ramp, &mut line)? {
//!     assert_eq!(line[20].map(f32::from), Some(3.0), "line {v}");
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | to do | begin with |
//! | --- | --- |
//! | match blocks, or along paths where there is little texture | [`Matcher`]; [`SemiGlobalMatcher`] |
//! | measure depth while the camera slides, frame by frame | [`SweepFilter`] |
//! | name the views, the search range and the fusion rule | [`SearchConfig`], [`Views`], [`Fusion`] |
//! | know the memory beforehand, or match in tiles to bound it | [`Memory`]; [`Region`] |
//! | turn disparities into distances | [`Triangulation`] |
//! | correct the lens and the mount while lines are read | [`Rectification`], [`Rectified`] |
//! | keep what is sure, or smooth it | [`ConfidenceLines`]; [`MedianLines`], [`TextureLines`] |
//! | move the camera and take the frames | [`capture`] |
//!
//! # Method
//! One camera is moved in its image plane and takes a centre image and neighbours, whole baselines away to the left,
//! right, top and bottom. A point has the same disparity for each baseline to all of them, so the matching costs of
//! the pairs are fused into one. The method is that of *Active Perception with A Monocular Camera
//! for Multiscopic Vision* (Yuan, Fan, Wang, Chen). The documentation of [`View`], [`Fusion`], [`SearchSpace`],
//! [`BlockMatchingParams`] and [`Disparity`] defines the result, bit for bit.
//!
//! # Modules
//! Data flows down this list, and each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `infallible` | what panics elsewhere for some input, as it is where it does not |
//! | `view` | [`View`], [`Frame`]: positions of the camera, and the places of matches |
//! | `views` | [`Views`]: a set of views, in order |
//! | `fusion` | [`Fusion`]: the fusion of the matching costs of several views into one |
//! | `disparity` | [`Disparity`]: fixed point, and sub-pixel refinement; [`Triangulation`], [`Depth`]: their distances |
//! | `params` | [`SearchConfig`], [`SearchSpace`], [`BlockMatchingParams`], [`SemiGlobalParams`]: the search, and the method |
//! | `error` | [`MatchError`], [`MemoryTooSmall`]: the errors of matching |
//! | `region` | [`Region`]: the part of the frame that a pass computes |
//! | `scanline` | [`ScanlineSource`], [`Rewind`]: sources of lines: memory, flash, a file or a sensor; [`Gradients`] of one |
//! | `brightness` | [`Histogram`], [`Evened`]: views as bright as the centre |
//! | `availability` | the frame's borders: the views that see a candidate |
//! | [`kernel`] | the inner loops, for the vectors of each instruction set |
//! | `memory` | [`Memory`]: the bytes of each buffer, which the caller lends |
//! | `rectification` | [`Rectification`], [`Rectified`]: a source's lines without the camera's distortion and tilt |
//! | `lines` | the lines of all frames that a line is compared with |
//! | `filters` | [`TextureLines`], [`MedianLines`], [`filter_by_confidence`]: filters of disparity lines |
//! | `confidence` | [`ConfidenceTable`], [`ConfidenceLines`]: the probability that a disparity is right |
//! | `matcher` | [`Matcher`]: pulls lines, and computes disparity lines by block matching |
//! | `semi_global` | [`SemiGlobalMatcher`]: the same by semi-global matching |
//! | `network` | with the feature `network`: the learned network in bounded memory |
//! | `sweep` | [`SweepFilter`]: refines disparities frame by frame while the camera slides |
//! | [`capture`] | taking the frames: the camera moves, settles and captures |
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
mod brightness;
pub mod capture;
mod confidence;
mod disparity;
mod error;
mod filters;
mod fusion;
mod infallible;
pub mod kernel;
mod lines;
mod matcher;
mod memory;
#[cfg(feature = "network")]
pub mod network;
mod params;
mod rectification;
mod region;
mod scanline;
mod semi_global;
mod sweep;
mod view;
mod views;

#[cfg(feature = "fixed")]
pub use fixed;

pub use brightness::{Evened, Histogram};
pub use confidence::{ConfidenceLines, ConfidenceTable, PeakRatio};
pub use disparity::{Depth, Disparity, Triangulation};
pub use error::{MatchError, MemoryTooSmall};
pub use filters::{CenterLines, MedianLines, ObservedSource, TextureLines, filter_by_confidence, slopes};
pub use fusion::{Fusion, MatchingCost};
pub use matcher::Matcher;
pub use memory::Memory;
pub use params::{
    Alike, BlockMatchingParams, Census, Params, ParamsError, PathPenalties, Prior, SearchConfig, SearchSpace, SemiGlobalCost,
    SemiGlobalParams, valid,
};
pub use rectification::{Displacement, DisplacementGrid, Rectification, RectificationError, Rectified, RectifiedError};
pub use region::{Region, RegionError};
pub use scanline::{Gradients, Rewind, ScanlineSource};
#[cfg(feature = "network")]
pub use semi_global::{EightPaths, EightPathsLine};
pub use semi_global::{PathWinners, SemiGlobalMatcher};
pub use sweep::{SweepFilter, SweepOffset, SweepParams, SweepParamsError, SweepPixel, SweepReader, SweepReport};
pub use view::{Frame, ParseViewError, View, ViewError};
pub use views::Views;
