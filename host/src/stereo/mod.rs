//! Stereo matching in its four steps (Scharstein and Szeliski 2002): matching cost, aggregation, optimization, refinement.

pub mod aggregation;
pub mod cost;
mod engine;
mod method;
pub mod optimization;
pub mod refinement;
mod simd;

pub use cost::Volume;
pub use engine::Engine;
pub use method::Method;
pub use simd::{Simd, Task};
