//! The commands, a module each: options, what they do, what they print.

pub mod align;
pub mod bench;
pub mod budget;
#[cfg_attr(not(all(target_os = "linux", feature = "v4l2")), path = "no_capture.rs")]
pub mod capture;
pub mod demo;
pub mod devices;
pub mod evaluate;
pub mod listen;
pub mod matching;
pub mod methods;
pub mod options;
pub mod simulate;
pub mod source;
pub mod terminal;
pub mod variant;
pub mod watch;
pub mod weights;
