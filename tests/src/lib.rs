//! What the tests share.

pub mod program;
pub mod random;
pub mod reference;
pub mod samples;
pub mod simulated;

/// The README's code compiles.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
