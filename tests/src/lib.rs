//! Code that the tests share: test images, and simulated hardware.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`program`] | the command line as a process, and captures that it makes |
//! | [`test_images`] | images and matches: golden, random, drawn and real |
//! | `killed_commands` | commands that are killed at random moments |
//! | [`simulated`] | arms, machines and cameras, with faults on demand |
//! | `soak` | captures over and over on that hardware |
//! | [`architecture`] | the rules that the workspace's sources keep |

#[cfg(feature = "xtask")]
pub mod architecture;
#[cfg(unix)]
pub mod killed_commands;
pub mod program;
pub mod simulated;
#[cfg(target_os = "linux")]
pub mod soak;
pub mod test_images;

/// Compiles and runs the code of the README and the guides.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
#[doc = include_str!("../../docs/architecture.md")]
#[doc = include_str!("../../docs/firmware.md")]
#[doc = include_str!("../../docs/first-map.md")]
struct Guides;
