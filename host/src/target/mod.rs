//! Microcontrollers as targets: predicting RAM and instructions, simulating the firmware's pipeline, and
//! receiving its packets.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`instruction_model`] | how many instructions a match takes: counted work times fitted prices |
//! | [`Processor`] | the supported cores, their clocks and vectors |
//! | [`MEASURED`] | what was measured with the firmware in the emulator |
//! | [`ram`] | the RAM that a match takes, buffer by buffer |
//! | [`simulate`] | the firmware's pipeline on the host |
//! | [`reception`] | disparity frames from the firmware's packets |

pub mod instruction_model;
mod measured;
mod processor;
pub mod ram;
pub mod reception;

pub use multiscopic_engine::{Simulation, SimulationError, simulate};

pub use measured::{FirmwareCostTable, FirmwareCosts, MEASURED};
pub use processor::Processor;
pub use ram::{Buffer, Ram};
