//! What the tests share.

pub mod arm;
pub mod ascii;
pub mod case;
pub mod command;
pub mod data;
pub mod energy;
pub mod golden;
pub mod images;
#[cfg(target_os = "linux")]
pub mod loopback;
#[cfg(target_os = "linux")]
pub mod luma;
#[cfg(unix)]
pub mod machine;
pub mod mccnn;
pub mod misaligned;
pub mod random;
pub mod reference;
pub mod semi_global;
pub mod source;
#[cfg(target_os = "linux")]
pub mod vivid;

/// The README's code compiles.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
