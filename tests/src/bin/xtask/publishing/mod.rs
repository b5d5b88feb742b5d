//! What others receive: crates, archives of the program, and what both depend on.

pub mod crates;
pub mod release;
pub mod supply_chain;
