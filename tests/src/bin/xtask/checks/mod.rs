//! The checks of the whole workspace, step by step.

pub mod aarch64;
pub mod instructions;
pub mod steps;
pub mod v4l2;
