//! Accurate depth from one camera that is moved on purpose: capture, matching, evaluation, and budgets for microcontrollers.
//!
//! Two pictures become disparities, the second of which was taken one baseline to the right:
//!
//! ```no_run
//! use multiscopic::{Engine, Frames, Method, files::{FrameFiles, write_pfm}};
//! use multiscopic_core::{Fusion, SearchConfig, View};
//!
//! let files = FrameFiles { center: "center.png".into(), ..FrameFiles::default() }.with(View::RIGHT, "right.png".into());
//! let (frames, _) = Frames::load(&files)?;
//! let [width, height] = frames.size().map(|side| side as u16);
//! // Disparities from 1 to 60 pixels.
//! let search = SearchConfig { views: frames.views(), fusion: Fusion::Min, ..SearchConfig::of_size(width, height) }.checked()?;
//! let disparities = Method::net().disparities(&Engine::new(None, 0)?, &frames, &search, &())?;
//! write_pfm(&disparities.to_float(), "disparity.pfm".as_ref())?;
//! # Ok::<(), multiscopic::Error>(())
//! ```
//!
//! The modules of this crate, in the order in which data flows through them. A module knows those above it, and none below:
//!
//! | module | what it is |
//! | --- | --- |
//! | [`error`], [`progress`], `caught` | what every module reports: errors that name the file, progress, and panics of other crates |
//! | `statistics` | medians and quantiles |
//! | [`images`] | rasters, pictures, the frames of a capture, disparity maps, and the geometry that turns disparity into depth |
//! | [`files`] | reading and writing them: pictures, maps of numbers, PLY, `rig.toml`; whole files or none |
//! | [`lens`] | lens distortion, the calibration files that describe it, and images without it |
//! | `calibration` | calibration of lenses, and of their places on the tools of arms, from images of a printed board |
//! | `scene` | ray-traced scenes with known depth |
//! | [`capture`] | cameras, the stages that move them, and the capture that runs both |
//! | [`stereo`] | matching: cost, aggregation, optimization, refinement, and the engine that runs the core on all cores |
//! | [`alignment`] | how far the views are from where they should be, estimated and taken out |
//! | `match_setup` | [`MatchSetup`]: what is done to frames before they are matched, and the warnings after it |
//! | [`evaluation`] | data sets with ground truth, error metrics, those of walls and repeated captures, and their tables |
//! | [`target`] | microcontrollers: memory and time budgets, the firmware's pipeline simulated, its packets received |

pub mod alignment;
#[cfg(feature = "calibration")]
pub mod calibration;
pub mod capture;
mod caught;
pub mod error;
pub mod evaluation;
pub mod files;
pub mod images;
pub mod lens;
mod match_setup;
pub mod progress {
    //! Reports of long-running work, and its interruption.

    pub use multiscopic_engine::Progress;
}
#[cfg(feature = "scene")]
pub mod scene;
mod statistics;
pub mod stereo;
pub mod target;

pub use alignment::{Alignment, Inspection};
pub use error::{Error, Result};
pub use evaluation::{Dataset, Metrics};
pub use files::Rig;
pub use images::{DisparityMap, FloatImage, Frames, Geometry, Picture, Raster};
pub use lens::{CameraModel, Lens, LensModel};
pub use match_setup::{MatchSetup, RangeSource};
pub use progress::Progress;
pub use stereo::{Engine, Method, SemiGlobal, Simd, Volume, memory::memory_limit, optimization::graph_cuts::GraphCuts};
pub use target::Processor;
