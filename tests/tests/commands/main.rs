//! The command line as users run it.

mod alignment;
mod arrays;
mod baselines;
mod board_photos;
mod command_line;
mod edge_commands;
mod evaluation;
mod layouts;
mod lens_calibration;
mod lenses;
mod photos;
mod rig_quality;
