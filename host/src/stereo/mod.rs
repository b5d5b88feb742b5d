//! Stereo matching in its four steps (Scharstein and Szeliski 2002): matching cost, aggregation, optimization, refinement.
//!
//! Choose a [`Method`]: [`Method::net`] is the trained network, [`Method::semi_global`] and [`Method::block_matching`] are
//! faster. [`MethodName`] lists all methods with their defaults. Then call [`Method::disparities`] with an [`Engine`], the
//! frames and the search, or [`Method::estimate`]. The modules below are the steps, for pipelines of your own.
//!
//! The kernels are those of the crate `multiscopic-engine`, whose types are re-exported here.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`Engine`], [`Simd`] | threads and vectors; block matching by the core, which is all four steps in one |
//! | [`cost`] | matching costs of a pixel and its matches, fused over the views |
//! | [`aggregation`] | costs averaged over a support region |
//! | [`optimization`] | the selection of disparities by their costs |
//! | [`refinement`] | checks and filters of the disparities |
//! | [`confidence_map`] | the probabilities that disparities are right |
//! | [`deviation`] | their standard deviations |
//! | [`BaselineRefinement`] | the refinement by views at longer baselines |
//! | [`network`] | a small network that decides between two passes of semi-global matching |
//! | [`SweepFrames`], [`fn@sweep`], [`dense_sweep`] | the frames of a camera that slides, and the filter over them, alone and beside a method |
//! | [`CostFunction`] | the costs of semi-global matching, and their names |
//! | [`Method`] | a [`Pipeline`] of these steps, and its [`Refinement`] |
//! | [`SemiGlobalMethod`] | semi-global matching as options describe it |
//! | [`MethodName`] | the methods by name, each with its defaults |
//! | [`next_view`] | the view that helps most, where depths are not as precise as asked for |

pub mod aggregation;
mod baselines;
pub mod confidence_map;
pub mod cost;
mod cost_function;
pub mod deviation;
pub(crate) mod memory;
mod merging;
mod method;
mod method_name;
pub mod next_view;
pub mod optimization {
    //! Optimization: the disparity of every pixel by its costs, and by those of its neighbours.

    pub mod edge_aware;
    pub mod graph_cuts;

    pub use multiscopic_engine::{sgm, winner};
}
pub mod refinement;
mod sweep;
mod sweep_frames;

pub use crate::files::npy::write_inputs;
pub use multiscopic_engine::{
    Engine, EngineError, Simd, Task, network,
    sgm::{Paths, SemiGlobal},
};

pub use baselines::BaselineRefinement;
pub use cost::Volume;
pub use cost_function::{CostFunction, CostName};
pub use method::{Estimate, Method, Pipeline};
pub use method_name::{MethodName, SemiGlobalMethod};
pub use refinement::Refinement;
pub use sweep::{Sweep, dense_sweep, growing_sweep, sweep};
pub use sweep_frames::SweepFrames;
