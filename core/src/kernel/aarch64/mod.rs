//! The vector instructions of 64-bit Arm.

mod neon;
mod neon_bytes;

pub use neon::Neon;
