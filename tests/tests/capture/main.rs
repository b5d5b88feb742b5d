//! Capture: its sequence, and the drivers of stages and cameras against simulated ones.

mod arm;
#[cfg(target_os = "linux")]
mod camera;
#[cfg(unix)]
mod gcode;
mod sequence;
