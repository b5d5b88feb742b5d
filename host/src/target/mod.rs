//! Microcontrollers as targets: memory and time budgets, the firmware's pipeline simulated, and its packets received.

pub mod budget;
pub mod instructions;
mod measured;
mod processor;
pub mod reception;
pub mod simulation;

pub use budget::{Buffer, Ram};
pub use measured::{MEASURED, Measured, Table};
pub use processor::Processor;
