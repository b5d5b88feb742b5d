//! The vector instructions of Arm's microcontrollers.

#[macro_use]
mod assembly;
mod dsp;
mod mve;

pub use dsp::Dsp;
pub use mve::Mve;
