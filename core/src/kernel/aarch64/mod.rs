//! The vector instructions of 64-bit Arm.

mod neon;

pub use neon::Neon;
