//! Vectors of 32 lanes of 16 bits, on every set of vector instructions.
//!
//! [`Vectors`] makes them and [`Vector`] is what can be done with them. The portable array is the definition.
//! All others give the same bits.

mod array;
mod definition;
#[cfg(target_arch = "x86_64")]
mod x86_64;

pub use definition::{LANES, Vector, Vectors};
