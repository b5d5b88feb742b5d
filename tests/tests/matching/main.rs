//! The core's matcher equals the float reference, bit for bit.

mod arithmetic;
mod bit_exact;
mod golden;
mod line_filters;
mod path_patterns;
mod patterns;
mod priors;
mod scanlines;
mod semi_global;
