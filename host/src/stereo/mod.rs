//! Stereo matching in its four steps (Scharstein and Szeliski 2002): matching cost, aggregation,
//! optimization, refinement.
//!
//! | room | what it is |
//! | --- | --- |
//! | [`Simd`] | the vector instructions of this processor |
//! | [`Engine`] | threads and vectors; block matching by the core, which is all four steps in one |
//! | [`cost`] | how much a pixel differs from its match, fused over the views |
//! | [`aggregation`] | costs averaged over a support region |
//! | [`optimization`] | from costs to disparities |
//! | [`refinement`] | checks and filters of the disparities |
//! | [`confidence_map`] | how probable it is that a disparity is right |
//! | [`LongBaselines`] | how views at longer baselines refine what those at the shortest found |
//! | [`network`] | a small network that decides between two passes of semi-global matching |
//! | [`Method`] | a choice for each of the four steps |
//! | [`SemiGlobalMethod`] | semi-global matching as options describe it |
//! | [`MethodName`] | the methods by name, each with its defaults |

pub mod aggregation;
mod baselines;
pub mod confidence_map;
pub mod cost;
mod engine;
mod memory_demand;
mod method;
mod method_name;
pub mod network;
pub mod optimization;
pub mod refinement;
mod semi_global_method;
mod simd;

pub use baselines::LongBaselines;
pub use cost::Volume;
pub use engine::Engine;
pub use method::{CostFunction, Method, Optimizer};
pub use method_name::MethodName;
pub use semi_global_method::{CostName, SemiGlobalMethod};
pub use simd::{Simd, Task};
