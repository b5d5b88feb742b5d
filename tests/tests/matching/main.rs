//! The core's matcher equals the float reference, bit for bit.

mod bit_exact;
mod line_filters;
mod patterns;
mod priors;
mod scanlines;
mod semi_global;
mod sweeps;
