//! Simulated hardware with faults on demand. It shares no code with the drivers under test.

pub mod arm;
#[cfg(target_os = "linux")]
pub mod cameras;
pub mod clock;
#[cfg(unix)]
pub mod machine;
pub mod network;
pub mod pose;
