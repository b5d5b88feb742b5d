//! What is computed, defined a second time: plain, slow, and without a line of the code under test.

mod block_matching;
pub mod energy;
#[cfg(target_os = "linux")]
pub mod luma;
pub mod networks;
pub mod semi_global;

pub use block_matching::{Fusion, Match, fixed, fuse, raw16};
