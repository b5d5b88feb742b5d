//! The cycles that sequences of instructions take, with memory that never waits.
//!
//! | file | what it is |
//! | --- | --- |
//! | `instruction` | the properties of an instruction that its time depends on, read from its text |
//! | `disassembly` | the instructions of a firmware image |
//! | `cortex_m4` | the Cortex-M4, whose manual gives every instruction's cycles |
//! | `scheduling_model` | LLVM's models of the Cortex-M7 and M55, which overlap instructions |
//! | `price` | the choice between them, and the cycles that taken branches and unaligned accesses add |

mod cortex_m4;
pub mod disassembly;
mod instruction;
pub mod price;
mod scheduling_model;
