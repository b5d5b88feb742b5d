//! Checks of the firmware on emulated boards.

pub mod bit_flips;
pub mod capturing;
pub mod cycles;
pub mod distorted_set;
pub mod faults;
pub mod frames;
pub mod kernel_twins;
pub mod pico2;
pub mod price_fit;
pub mod profiles;
pub mod rectifying;
