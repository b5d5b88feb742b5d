//! What others receive: crates, archives of the program, and what both depend on.

pub mod crates;
pub mod public_api;
pub mod release;
pub mod supply_chain;
