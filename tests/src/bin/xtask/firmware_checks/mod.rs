//! Checks of the firmware on emulated boards.

pub mod bit_flips;
pub mod cycles;
pub mod examples;
pub mod frames;
pub mod price_fit;
pub mod profiles;
pub mod rectifying;
