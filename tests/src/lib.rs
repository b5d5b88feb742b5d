//! What the tests share.

pub mod arm;
pub mod ascii;
pub mod case;
pub mod command;
pub mod data;
pub mod golden;
pub mod images;
pub mod misaligned;
#[cfg(unix)]
pub mod machine;
pub mod random;
pub mod reference;
pub mod source;

/// The README's code compiles.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
