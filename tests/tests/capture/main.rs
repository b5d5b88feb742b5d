//! Capture: the sequence, and the drivers of stages and cameras with simulated hardware.

mod arm;
#[cfg(unix)]
mod arm_frame;
#[cfg(target_os = "linux")]
mod camera;
#[cfg(target_os = "linux")]
mod exec;
#[cfg(unix)]
mod gcode;
mod hostile_arm;
mod hostile_command;
#[cfg(unix)]
mod hostile_machine;
mod http;
mod path;
mod sequence;
mod simulated;
#[cfg(unix)]
mod sweep;
