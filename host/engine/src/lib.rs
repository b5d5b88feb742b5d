//! Runs the stereo kernels of `multiscopic-core` on all threads and with the widest vector instructions of this processor.
//!
//! Make an [`Engine`], lend it images as [`Planes`], and call one of:
//!
//! - [`Engine::disparities`] for block matching;
//! - [`SemiGlobal::optimize`](sgm::SemiGlobal::optimize) for semi-global matching, with a cost from [`cost`];
//! - [`DisparityNetwork::disparities`](network::DisparityNetwork::disparities) for the network, on its
//!   [`Inputs`](network::Inputs).
//!
//! The result is a [`DisparityMap`]. Most programs use the crate `multiscopic` instead, which reads pictures, combines these
//! steps into methods and re-exports the types below.
//!
//! ```
//! use multiscopic_core::{Fusion, SearchConfig, View, Views};
//! use multiscopic_engine::{Engine, Planes};
//!
//! // A scene of random texture, two pixels further to the left in the right view.
//! let (width, height) = (64, 32);
//! let texture = |u: usize, v: usize| ((u * 2654435761 + v * 40503) >> 7) as u8;
//! let image = |shift: usize| (0..width * height).map(|i| texture(i % width + shift, i / width)).collect::<Vec<u8>>();
//! let (center, right) = (image(0), image(2));
//! let frames = Planes::new([width, height], &center).with(View::RIGHT, &right);
//!
//! let params = SearchConfig { width: 64, height: 32, views: Views::STEREO, fusion: Fusion::Min, min_disparity: 0, num_disparities: 8 }
//!     .block_matching(5)?;
//! let map = Engine::default().disparities(&frames, &params, &|| ())?;
//! assert_eq!(map.get(40, 16).map(f32::from), Some(2.0));
//! # Ok::<(), multiscopic_engine::EngineError>(())
//! ```
//!
//! | module | what it is |
//! | --- | --- |
//! | `progress` | [`Progress`]: reports of long work, and its interruption |
//! | `raster`, `disparity_map` | [`Raster`], [`DisparityMap`]: grids of pixels |
//! | `planes` | [`Planes`]: the grey frames of a set, borrowed |
//! | `error` | [`EngineError`]: the reasons that frames cannot be matched |
//! | `simd` | [`Simd`]: the vector instructions of this processor |
//! | `engine` | [`Engine`]: threads and vector instructions, and block matching on both |
//! | [`cost`] | fused matching costs, row by row |
//! | [`winner`] | winner-takes-all over costs |
//! | [`sgm`] | semi-global matching |
//! | [`network`] | a small network that decides between two passes of semi-global matching |
//! | `simulation` | [`simulate`], [`simulate_sweep`]: the firmware's pipeline, in the memory that it has there |
//!
//! The core defines every result, generic over instruction sets. This crate compiles it once, behind functions that are not
//! generic, so that its users compile no kernel.

pub mod cost;
mod disparity_map;
mod engine;
mod error;
pub mod network;
mod planes;
mod progress;
mod raster;
pub mod sgm;
mod simd;
mod simulation;
pub mod winner;

pub use disparity_map::DisparityMap;
pub use engine::Engine;
pub use error::EngineError;
pub use planes::Planes;
pub use progress::Progress;
pub use raster::{FloatImage, Raster};
pub use simd::{Simd, Task};
pub use simulation::{Simulation, SimulationError, simulate, simulate_sweep};
