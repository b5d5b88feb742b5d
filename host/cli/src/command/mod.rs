//! The commands, a module each, and what they share: [`options`] and the [`terminal`].

pub mod advice;
pub mod align;
pub mod batch;
pub mod bench;
pub mod budget;
mod c_header;
pub mod calibrate;
mod cameras;
pub mod capture;
#[cfg(feature = "live")]
mod connections;
pub mod demo;
pub mod evaluate;
#[cfg(feature = "live")]
mod foxglove;
pub mod hardware;
pub mod listen;
#[cfg(feature = "live")]
pub mod live;
#[cfg(feature = "manuals")]
pub mod manuals;
pub mod r#match;
pub mod merge;
mod options;
mod preparation;
#[cfg(unix)]
mod raw_port;
pub mod rig;
pub mod scene;
pub mod simulate;
pub mod terminal;
mod variant;
pub mod view;
pub mod weights;

use std::sync::OnceLock;

use multiscopic::files::Limits;

/// The limits of what this run reads: those of `--max-pixels`.
static LIMITS: OnceLock<Limits> = OnceLock::new();

/// Sets the limits of this run, before anything is read.
pub fn set_limits(limits: Limits) {
    LIMITS.set(limits).expect("the limits are set once");
}

/// The limits of this run.
pub fn limits() -> Limits {
    LIMITS.get().copied().unwrap_or_default()
}
