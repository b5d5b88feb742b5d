//! Capture: the sequence, and the drivers of stages and cameras with simulated hardware.

mod arm;
#[cfg(target_os = "linux")]
mod camera;
#[cfg(unix)]
mod gcode;
mod hostile_arm;
#[cfg(unix)]
mod hostile_machine;
mod path;
mod sequence;
mod simulated;
