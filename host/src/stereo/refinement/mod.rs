//! Refinement: what is done to disparities after they have been selected.

pub mod filter;
