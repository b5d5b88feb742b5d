//! Everything that is published: crates, archives of the program, and the dependencies of both.

pub mod crates;
pub mod public_api;
pub mod release;
pub mod supply_chain;
