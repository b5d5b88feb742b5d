//! The checks of the whole workspace, step by step.

pub mod aarch64;
pub mod instructions;
pub mod suite;
pub mod v4l2;
