//! Simulated hardware with faults on demand. It shares no code with the drivers under test.

pub mod arm;
pub mod clock;
#[cfg(target_os = "linux")]
pub mod loopback;
#[cfg(unix)]
pub mod machine;
mod motion;
pub mod network;
pub mod pose;
#[cfg(target_os = "linux")]
pub mod vivid;
