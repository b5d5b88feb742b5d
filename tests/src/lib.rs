//! What the tests share: reference implementations, test images, and simulated hardware.
//!
//! | room | what it is |
//! | --- | --- |
//! | [`split_mix`] | random numbers that are the same everywhere |
//! | [`reference`] | the definitions that the product is compared with |
//! | [`program`] | the command line as a process |
//! | [`test_images`] | images and matches: golden, random, drawn and real |
//! | [`simulated`] | arms, machines and cameras, with faults on demand |
//! | [`architecture`] | the rules that the workspace's sources keep |

#[cfg(feature = "xtask")]
pub mod architecture;
pub mod program;
pub mod reference;
pub mod simulated;
pub mod split_mix;
pub mod test_images;

/// Compiles the README's code.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
